#include "leading_columns.h"

#include "sample_rows.h"

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

} // namespace

Leading leadingColumn(const SampleRows& rows, std::size_t column)
{
    if (rows.size() < kMinRows || rows.front().size() < column + 4) return Leading::Coordinate;
    const bool finite = std::all_of(rows.begin(), rows.end(), [&](const auto& row) {
        return std::all_of(row.begin(), row.end(), [](double v) { return std::isfinite(v); });
    });
    if (!finite || !always(rows, column, [](double a, double b) { return a <= b; }))
        return Leading::Coordinate;
    const double ratio = ratioToOthers(rows, column);
    if (rows.front()[column] >= kLeastTime && ratio >= kTimeRatio) return Leading::Time;
    if (!rises(rows, column) || areUnit(rows, column + 3)) return Leading::Coordinate;
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

bool mayBeRasterLine(const SampleRows& rows, std::size_t column)
{
    if (rows.front().size() < column + 4 || !rises(rows, column)) return false;
    return isConstant(rows, column + 1) || haveEvenSteps(rows, column + 1);
}

Leading leadingIfItFalls(Leading seemed)
{
    if (seemed == Leading::Number) return Leading::Unclear;
    return seemed == Leading::Unclear ? Leading::Coordinate : seemed;
}

} // namespace mpuvdb
