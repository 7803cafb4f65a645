// Solids from text: name(argument, ...), an argument being a number or a solid.
#include "solids.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <functional>
#include <string_view>

namespace mpuvdb
{
namespace
{

/// The arguments of one call, in order within their kind.
struct Arguments {
    std::vector<SolidPtr> solids;
    std::vector<double> numbers;
};

struct Maker {
    std::string_view name;
    std::string_view arguments; ///< for the help and for errors
    std::string_view meaning;
    int solids; ///< how many; -1: one or more
    int numbers;
    /// An error in the numbers; empty without one.
    std::function<std::string(const std::vector<double>&)> complaint;
    std::function<SolidPtr(const Arguments&)> make;
};

std::string wantPositive(const std::vector<double>& n)
{
    for (std::size_t i = 0; i < n.size(); ++i)
        if (!(n[i] > 0))
            return fmt::format("number {} is {}, and sizes must be above 0", i + 1, n[i]);
    return {};
}

std::string acceptAll(const std::vector<double>&)
{
    return {};
}

SolidPtr moveBy(SolidPtr solid, const Vec3d& by)
{
    return makeMoved(std::move(solid), Eigen::Matrix3d::Identity(), 1, by);
}

/// Two slabs of a tenth of the gap, their facing sides @a gap apart.
SolidPtr makeSheets(double x, double y, double gap)
{
    const double thickness = gap / 10;
    const SolidPtr sheet = makeBox({x, y, thickness}, 0);
    const Vec3d up(0, 0, (gap + thickness) / 2);
    return makeUnion({moveBy(sheet, up), moveBy(sheet, -up)});
}

/// A root cylinder, teeth to the outer radius as wide as the gaps, and a bore of a third of it.
SolidPtr makeGear(int teeth, double radius, double height)
{
    const double root = 0.8 * radius, width = M_PI * root / teeth;
    const double length = radius - root / 2;
    const SolidPtr tooth = moveBy(makeBox({length, width, height}, 0), {radius - length / 2, 0, 0});
    return makeDifference({makeUnion({makeCylinder(root, height), makeRing(tooth, teeth)}),
                           makeCylinder(radius / 3, 2 * height)});
}

/// A block with a curved shoulder, a chamfered edge, a through hole, a blind hole and a rib:
/// planes, cylinders, convex and concave creases, corners of degree three and four.
SolidPtr makeFandisk(double size)
{
    static const char* const kPart =
        "difference("
        "  union("
        "    intersection(box(1, 0.7, 0.4), translate(cylinder(0.75, 1), -0.2, 0.1, 0)),"
        "    translate(box(0.1, 0.5, 0.3), -0.25, 0, 0.25),"
        "    translate(cylinder(0.15, 0.25), 0.15, 0, 0.2)),"
        "  translate(cylinder(0.08, 1), 0.15, 0, 0),"
        "  translate(cylinder(0.06, 0.2), -0.4, -0.15, 0.2),"
        "  translate(rotate(box(0.3, 2, 0.3), 0, 1, 0, 45), 0.55, 0, 0.25))";
    return makeMoved(parseSolid(kPart), Eigen::Matrix3d::Identity(), size, Vec3d::Zero());
}

std::vector<Maker> primitiveMakers()
{
    const auto roundingFits = [](const std::vector<double>& n) {
        const bool fits = n[3] <= std::min({n[0], n[1], n[2]}) / 2;
        return !wantPositive(n).empty() ? wantPositive(n)
               : fits                   ? std::string()
                                        : std::string("r must be at most half the smallest side");
    };
    const auto tubeFits = [](const std::vector<double>& n) {
        return !wantPositive(n).empty() ? wantPositive(n)
               : n[1] < n[0]            ? std::string()
                             : std::string("the tube's radius r must be less than the ring's R");
    };
    const auto bumpsFit = [](const std::vector<double>& n) {
        return !wantPositive(n).empty() ? wantPositive(n)
               : n[2] <= n[0] / 8       ? std::string()
                                        : std::string("amplitude must be at most r / 8");
    };
    const auto teethFit = [](const std::vector<double>& n) {
        const bool whole = n[0] == std::floor(n[0]) && n[0] >= 3 && n[0] <= 1000;
        return !wantPositive(n).empty() ? wantPositive(n)
               : whole                  ? std::string()
                       : std::string("teeth must be a whole number from 3 to 1000");
    };
    using A = const Arguments&;
    return {
        {"sphere", "r", "radius", 0, 1, wantPositive, [](A a) { return makeSphere(a.numbers[0]); }},
        {"torus", "R,r", "radii of the ring about z and of its tube", 0, 2, tubeFits,
         [](A a) { return makeTorus(a.numbers[0], a.numbers[1]); }},
        {"box", "x,y,z", "full sizes", 0, 3, wantPositive,
         [](A a) {
             return makeBox({a.numbers[0], a.numbers[1], a.numbers[2]}, 0);
         }},
        {"roundedbox", "x,y,z,r", "full sizes, radius of the edges", 0, 4, roundingFits,
         [](A a) {
             return makeBox({a.numbers[0], a.numbers[1], a.numbers[2]}, a.numbers[3]);
         }},
        {"ellipsoid", "x,y,z", "radii along the axes", 0, 3, wantPositive,
         [](A a) {
             return makeEllipsoid({a.numbers[0], a.numbers[1], a.numbers[2]});
         }},
        {"capsule", "r,length", "radius, length of the straight part along z", 0, 2, wantPositive,
         [](A a) { return makeCapsule(a.numbers[0], a.numbers[1]); }},
        {"cylinder", "r,height", "radius, height along z", 0, 2, wantPositive,
         [](A a) { return makeCylinder(a.numbers[0], a.numbers[1]); }},
        {"cone", "r,height", "radius of the base, height along z", 0, 2, wantPositive,
         [](A a) { return makeCone(a.numbers[0], a.numbers[1]); }},
        {"slab", "x,y,thickness", "a thin box", 0, 3, wantPositive,
         [](A a) {
             return makeBox({a.numbers[0], a.numbers[1], a.numbers[2]}, 0);
         }},
        {"sheets", "x,y,gap", "two parallel sheets, each a tenth of the gap thick", 0, 3,
         wantPositive, [](A a) { return makeSheets(a.numbers[0], a.numbers[1], a.numbers[2]); }},
        {"blob", "r,bumps,amplitude", "sphere with this number of bumps around", 0, 3, bumpsFit,
         [](A a) { return makeBlob(a.numbers[0], a.numbers[1], a.numbers[2]); }},
        {"gear", "teeth,r,height", "toothed wheel with a bore", 0, 3, teethFit,
         [](A a) { return makeGear(int(a.numbers[0]), a.numbers[1], a.numbers[2]); }},
        {"fandisk", "size", "machined part with creases and corners", 0, 1, wantPositive,
         [](A a) { return makeFandisk(a.numbers[0]); }},
    };
}

std::vector<Maker> operationMakers()
{
    const auto wantAxis = [](const std::vector<double>& n) {
        return Vec3d(n[0], n[1], n[2]).norm() > 0 ? std::string()
                                                  : std::string("the axis must not be zero");
    };
    using A = const Arguments&;
    return {
        {"union", "solid,...", "points in any of them", -1, 0, acceptAll,
         [](A a) { return makeUnion(a.solids); }},
        {"intersection", "solid,...", "points in all of them", -1, 0, acceptAll,
         [](A a) { return makeIntersection(a.solids); }},
        {"difference", "solid,...", "the first without the others", -1, 0, acceptAll,
         [](A a) { return makeDifference(a.solids); }},
        {"translate", "solid,x,y,z", "moved", 1, 3, acceptAll,
         [](A a) {
             return moveBy(a.solids[0], {a.numbers[0], a.numbers[1], a.numbers[2]});
         }},
        {"rotate", "solid,x,y,z,degrees", "turned about the axis (x,y,z)", 1, 4, wantAxis,
         [](A a) {
             const Vec3d axis(a.numbers[0], a.numbers[1], a.numbers[2]);
             const Eigen::AngleAxisd turn(a.numbers[3] * M_PI / 180, axis.normalized());
             return makeMoved(a.solids[0], turn.toRotationMatrix(), 1, Vec3d::Zero());
         }},
        {"scale", "solid,s", "scaled about the origin", 1, 1, wantPositive,
         [](A a) {
             return makeMoved(a.solids[0], Eigen::Matrix3d::Identity(), a.numbers[0],
                              Vec3d::Zero());
         }},
    };
}

const std::vector<Maker>& makers()
{
    static const std::vector<Maker> all = [] {
        std::vector<Maker> m = primitiveMakers();
        for (Maker& o : operationMakers()) m.push_back(std::move(o));
        return m;
    }();
    return all;
}

class Parser
{
public:
    explicit Parser(std::string_view text) : mText(text) {}

    SolidPtr parse()
    {
        SolidPtr solid = parseSolidAt(0);
        skipSpace();
        if (mAt != mText.size()) fail(mAt, "expected the end");
        return solid;
    }

private:
    [[noreturn]] void fail(std::size_t at, const std::string& what) const
    {
        throw UsageError(fmt::format("solid \"{}\", character {}: {}. Write for example "
                                     "difference(box(2,2,1),cylinder(0.4,3))",
                                     mText, at + 1, what));
    }
    void skipSpace()
    {
        while (mAt < mText.size() && (mText[mAt] == ' ' || mText[mAt] == '\n')) ++mAt;
    }
    bool take(char c)
    {
        skipSpace();
        if (mAt == mText.size() || mText[mAt] != c) return false;
        ++mAt;
        return true;
    }
    bool atLetter()
    {
        skipSpace();
        return mAt < mText.size() && mText[mAt] >= 'a' && mText[mAt] <= 'z';
    }

    const Maker& parseName()
    {
        skipSpace();
        const std::size_t start = mAt;
        while (mAt < mText.size() && mText[mAt] >= 'a' && mText[mAt] <= 'z') ++mAt;
        const std::string_view name = mText.substr(start, mAt - start);
        std::string known;
        for (const Maker& m : makers()) {
            if (m.name == name) return m;
            known += (known.empty() ? "" : ", ") + std::string(m.name);
        }
        fail(start, fmt::format("expected a solid, one of: {}", known));
    }

    double parseNumber()
    {
        skipSpace();
        double value = 0;
        const char* const begin = mText.data() + mAt;
        const char* const end = mText.data() + mText.size();
        const auto result = std::from_chars(begin, end, value);
        if (result.ec != std::errc() || !std::isfinite(value))
            fail(mAt, "expected a number or a solid");
        mAt += std::size_t(result.ptr - begin);
        return value;
    }

    Arguments parseArguments(const Maker& maker, int depth)
    {
        Arguments a;
        if (!take('(')) fail(mAt, fmt::format("expected {}({})", maker.name, maker.arguments));
        do {
            if (atLetter() && a.numbers.empty())
                a.solids.push_back(parseSolidAt(depth + 1));
            else
                a.numbers.push_back(parseNumber());
        } while (take(','));
        if (!take(')')) fail(mAt, "expected , or )");
        return a;
    }

    SolidPtr parseSolidAt(int depth)
    {
        // The depth of recursion, in parsing and in evaluation. [tuned: a thread's stack]
        constexpr int kMaxDepth = 100;
        skipSpace();
        const std::size_t start = mAt;
        if (depth > kMaxDepth) fail(start, fmt::format("nested deeper than {}", kMaxDepth));
        const Maker& maker = parseName();
        const Arguments a = parseArguments(maker, depth);
        const bool solidsFit =
            maker.solids < 0 ? !a.solids.empty() : int(a.solids.size()) == maker.solids;
        if (!solidsFit || int(a.numbers.size()) != maker.numbers)
            fail(start, fmt::format("the arguments are {}({})", maker.name, maker.arguments));
        const std::string complaint = maker.complaint(a.numbers);
        if (!complaint.empty())
            fail(start, fmt::format("{}({}): {}", maker.name, maker.arguments, complaint));
        return maker.make(a);
    }

    std::string_view mText;
    std::size_t mAt = 0;
};

} // namespace

std::shared_ptr<const Solid> parseSolid(const std::string& description)
{
    SolidPtr solid = Parser(description).parse();
    if (solid->bounds().isEmpty())
        throw InputError(fmt::format("solid \"{}\": empty, its parts do not meet. Move or enlarge "
                                     "them",
                                     description));
    return solid;
}

std::string solidHelp()
{
    std::string help = "Solids, centered at the origin; lengths are world units:\n";
    for (const Maker& m : makers())
        help += fmt::format("  {:<32} {}\n", fmt::format("{}({})", m.name, m.arguments), m.meaning);
    return help;
}

} // namespace mpuvdb
