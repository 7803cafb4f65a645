#include "leading_columns.h"

#include "sample_rows.h"

#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

/// Least rows whose order says something. [derived: so many numbers without an order rise with
/// probability 1 / 8!, 2.5e-5]
constexpr std::size_t kMinRows = 8;
/// Least number of an epoch's time, seconds. [derived: the earth is 4e7 meters around, so that no
/// coordinate in meters comes near; of the times since 1970 all after 1973 are larger]
constexpr double kLeastTime = 1e8;
/// Least ratio of such a time to all coordinates beside it. [derived: since 1970 it is 1.6e9 s and
/// more, 100 times the largest northing, and x is not much larger than y in any system]
constexpr double kTimeRatio = 30;
/// Least ratio to all numbers beside it at which a rising column may be a time of any clock.
/// [free: a local cloud's coordinates have less, a day's seconds have more]
constexpr double kFarRatio = 1000;
/// Least magnitude of coordinates that may be written without their decimals. [derived: 'g' formats
/// write six digits]
constexpr double kSixDigits = 1e5;
/// Largest standard deviation of even steps, times their mean. [derived: half of what sorted
/// random numbers have]
constexpr double kEvenSteps = 0.5;

/// Whether f(value before, value) holds from row to row.
template <class F>
bool always(const SampleRows& rows, std::size_t column, const F& f)
{
    return std::adjacent_find(rows.begin(), rows.end(), [&](const auto& a, const auto& b) {
               return !f(a[column], b[column]);
           }) == rows.end();
}

template <class F>
std::size_t count(const SampleRows& rows, std::size_t column, const F& f)
{
    return std::size_t(
        std::count_if(rows.begin(), rows.end(), [&](const auto& row) { return f(row[column]); }));
}

bool areWhole(const SampleRows& rows, std::size_t column)
{
    return count(rows, column, isWhole) == rows.size();
}

bool areMostlyBroken(const SampleRows& rows, std::size_t column)
{
    return 2 * count(rows, column, isWhole) < rows.size();
}

bool isConstant(const SampleRows& rows, std::size_t column)
{
    return always(rows, column, [](double a, double b) { return a == b; });
}

bool rises(const SampleRows& rows, std::size_t column)
{
    return always(rows, column, [](double a, double b) { return a < b; });
}

bool neverFalls(const SampleRows& rows, std::size_t column)
{
    return always(rows, column, [](double a, double b) { return a <= b; });
}

bool riseAndFall(const SampleRows& rows, std::size_t column)
{
    return !always(rows, column, [](double a, double b) { return a <= b; }) &&
           !always(rows, column, [](double a, double b) { return a >= b; });
}

/// The least of a column over the largest magnitude in the three behind it.
double ratioToOthers(const SampleRows& rows, std::size_t column)
{
    double least = rows.front()[column], largest = 0;
    for (const auto& row : rows) {
        least = std::min(least, row[column]);
        for (std::size_t c = column + 1; c < column + 4; ++c)
            largest = std::max(largest, std::abs(row[c]));
    }
    return largest > 0 ? least / largest : 0;
}

bool haveEvenSteps(const SampleRows& rows, std::size_t column)
{
    const double steps = double(rows.size() - 1);
    const double mean = (rows.back()[column] - rows.front()[column]) / steps;
    double sum = 0;
    for (std::size_t i = 1; i < rows.size(); ++i) {
        const double off = rows[i][column] - rows[i - 1][column] - mean;
        sum += off * off;
    }
    return std::sqrt(sum / steps) < kEvenSteps * std::abs(mean);
}

bool areColors(const SampleRows& rows, std::size_t column)
{
    return mostTriples(rows, column, [](const double* t) {
        return std::all_of(t, t + 3, [](double v) { return isWhole(v) && v >= 0; });
    });
}

/// Whether whole numbers that rise are no coordinate: they count from 0 or 1, or those beside them
/// have fractions, which all coordinates have or none. Along a line of a raster that lies straight,
/// y is constant; of one that lies askew, y has even steps, and z is behind it. A flat
/// face may have x constant for longer than any line.
bool areNumbers(const SampleRows& rows, std::size_t column)
{
    const bool liesStraight = isConstant(rows, column + 1);
    if (!areWhole(rows, column) || (liesStraight && rows.size() < kRisingRows)) return false;
    const double first = rows.front()[column];
    const bool counts = (first == 0 || first == 1) &&
                        always(rows, column, [](double a, double b) { return b == a + 1; });
    const bool isEven = haveEvenSteps(rows, column + 1);
    return (counts && !(isEven && !isConstant(rows, column + 2))) ||
           (!isEven && (liesStraight || areMostlyBroken(rows, column + 1)) &&
            areMostlyBroken(rows, column + 2));
}

/// Whether most steps from row to row are the same, as along a raster's lines.
bool hasSteadySteps(const SampleRows& rows, std::size_t column)
{
    std::vector<double> steps;
    for (std::size_t i = 1; i < rows.size(); ++i)
        steps.push_back(rows[i][column] - rows[i - 1][column]);
    const auto middle = steps.begin() + std::ptrdiff_t(steps.size() / 2);
    std::nth_element(steps.begin(), middle, steps.end());
    const auto same = std::size_t(std::count(steps.begin(), steps.end(), *middle));
    return *middle != 0 && 2 * same > steps.size();
}

/// Whether a column has whole numbers, not for want of digits, beside three that have fractions.
bool standsOut(const SampleRows& rows, std::size_t column)
{
    return areWhole(rows, column) && areMostlyBroken(rows, column + 1) &&
           areMostlyBroken(rows, column + 2) && areMostlyBroken(rows, column + 3) &&
           count(rows, column, [](double v) { return std::abs(v) < kSixDigits; }) >= kMinRows;
}

/// Whole numbers that do not rise in every row: of classes, scans, intensities, or of the rows in
/// some other order. Normals or colors behind the fourth column make the three before it a
/// position; else those that never fall may be the stations of profiles.
Leading labelOrCoordinate(const SampleRows& rows, std::size_t column)
{
    if (!standsOut(rows, column) || hasSteadySteps(rows, column)) return Leading::Coordinate;
    const bool isSettled = areUnit(rows, column + 4) || areColors(rows, column + 4);
    return isSettled || riseAndFall(rows, column) ? Leading::Label : Leading::UnclearLabel;
}

bool isInUnitCube(const double* t)
{
    return std::all_of(t, t + 3, [](double v) { return v >= 0 && v <= 1; });
}

/// Whether three columns may be a color and another three, which are none, its position; points
/// of a small solid with vectors that are not normalized look the same.
bool mayBeColors(const SampleRows& rows, std::size_t column)
{
    const auto areBytes = [](const double* t) {
        return std::all_of(t, t + 3, [](double v) { return isWhole(v) && v >= 0 && v <= 255; });
    };
    return (mostTriples(rows, column, areBytes) || mostTriples(rows, column, isInUnitCube)) &&
           areMostlyBroken(rows, column + 3) && areMostlyBroken(rows, column + 4) &&
           areMostlyBroken(rows, column + 5) && !mostTriples(rows, column + 3, isInUnitCube) &&
           !areUnit(rows, column + 4);
}

/// Three columns of unit length before another three: points of the unit sphere have normals or
/// colors behind them, in parallel to themselves or up to 1.
Leading normalsOrPosition(const SampleRows& rows, std::size_t column)
{
    const bool areOnSphere = areColors(rows, column + 3) || areUnit(rows, column + 4) ||
                             areUnit(rows, column + 6) || areUnit(rows, column + 7);
    if (areOnSphere) return Leading::Coordinate;
    const bool mayBeOnSphere = mostTriples(rows, column, [](const double* t) {
        const double squared = t[3] * t[3] + t[4] * t[4] + t[5] * t[5];
        const double along = t[0] * t[3] + t[1] * t[4] + t[2] * t[5];
        return isInUnitCube(t + 3) || along * along > 0.9 * squared;
    });
    return mayBeOnSphere ? Leading::UnclearNormals : Leading::Normals;
}

Leading judge(const SampleRows& rows, std::size_t column)
{
    if (rows.size() < kMinRows || rows.front().size() < column + 4) return Leading::Coordinate;
    const double ratio = ratioToOthers(rows, column);
    if (neverFalls(rows, column) && rows.front()[column] >= kLeastTime && ratio >= kTimeRatio)
        return Leading::Time;
    if (areUnit(rows, column + 3)) return Leading::Coordinate;
    if (rows.front().size() >= column + 6) {
        if (areUnit(rows, column)) return normalsOrPosition(rows, column);
        if (mayBeColors(rows, column)) return Leading::UnclearColors;
    }
    if (!rises(rows, column)) return labelOrCoordinate(rows, column);
    if (areNumbers(rows, column)) return Leading::Number;
    // An intensity in whole numbers makes the three before it a position, and so does a color.
    const bool areAttributes = areColors(rows, column + 3) ||
                               (areWhole(rows, column + 3) && areMostlyBroken(rows, column + 1) &&
                                areMostlyBroken(rows, column + 2));
    const bool othersTurn = riseAndFall(rows, column + 1) && riseAndFall(rows, column + 2) &&
                            riseAndFall(rows, column + 3);
    const bool mayBeTime = haveEvenSteps(rows, column) || ratio >= kFarRatio;
    return othersTurn && mayBeTime && !areAttributes ? Leading::Unclear : Leading::Coordinate;
}

/// The rows whose numbers are all finite: the others are no points, and say nothing.
SampleRows finiteRows(const SampleRows& rows)
{
    SampleRows finite;
    std::copy_if(rows.begin(), rows.end(), std::back_inserter(finite), [](const auto& row) {
        return std::all_of(row.begin(), row.end(), [](double v) { return std::isfinite(v); });
    });
    return finite;
}

} // namespace

Leading leadingColumn(const SampleRows& rows, std::size_t column)
{
    return judge(finiteRows(rows), column);
}

bool mayChange(Leading seemed, const SampleRows& rows, std::size_t column)
{
    if (seemed == Leading::UnclearLabel) return true; // a flat face, or a class of many points
    if (seemed != Leading::Coordinate || rows.front().size() < column + 4 || !rises(rows, column))
        return false;
    return isConstant(rows, column + 1) || haveEvenSteps(rows, column + 1);
}

bool hasToRise(Leading seemed)
{
    return seemed == Leading::Number || seemed == Leading::Time || seemed == Leading::Unclear;
}

Leading leadingIfItFalls(Leading seemed)
{
    if (seemed == Leading::Number) return Leading::Unclear;
    return seemed == Leading::Unclear ? Leading::Coordinate : seemed;
}

std::string whatItIs(Leading meaning, std::size_t column)
{
    if (meaning == Leading::Normals)
        return fmt::format("columns {}, {} and {} are of unit length, so normals", column + 1,
                           column + 2, column + 3);
    if (meaning == Leading::Label)
        return fmt::format("column {} has whole numbers beside coordinates with decimals, and is "
                           "left out",
                           column + 1);
    return fmt::format("column {} {} the rows", column + 1,
                       meaning == Leading::Time ? "times" : "numbers");
}

std::string whyUnclear(Leading meaning, std::size_t column)
{
    if (meaning == Leading::Unclear)
        return fmt::format("column {} rises from row to row: it may be x, or number or time the "
                           "rows. Name the columns in the first line, such as 'x y z intensity' or "
                           "'time x y z'.",
                           column + 1);
    if (meaning == Leading::UnclearLabel)
        return fmt::format("column {} has whole numbers that never fall, beside columns with "
                           "decimals: it may be x, or number the scans, classes or rows. Name the "
                           "columns in the first line, such as 'x y z intensity' or 'class x y z'.",
                           column + 1);
    if (meaning == Leading::UnclearNormals)
        return fmt::format("columns {}, {} and {} are of unit length: they may be positions or "
                           "normals. Name the columns in the first line, such as 'x y z r g b' or "
                           "'nx ny nz x y z'.",
                           column + 1, column + 2, column + 3);
    if (meaning == Leading::UnclearColors)
        return fmt::format("columns {}, {} and {} may be positions or colors. Name the columns in "
                           "the first line, such as 'x y z nx ny nz' or 'r g b x y z'.",
                           column + 1, column + 2, column + 3);
    return {};
}

} // namespace mpuvdb
