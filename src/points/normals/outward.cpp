#include "outward.h"

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace mpuvdb
{
namespace
{

/// Decides part after part, the largest first; smaller ones see what is decided.
class PartTurner
{
public:
    PartTurner(const std::vector<Part>& parts, const OrientedParts& points)
        : mParts(parts), mPoints(points)
    {
    }

    bool isInward(std::size_t part)
    {
        const bool inward = looksInward(part);
        constexpr std::size_t kMost = 64; // parts; [tuned: contour_normals_test]
        if (mParts[part].points.size() >= kFewestPoints && mDecided.size() < kMost)
            decide(part, inward);
        return inward;
    }

private:
    /// A part that is decided, and the sums of the winding numbers of all such at a few points.
    struct Decided {
        std::size_t part;
        PartWinding winding;
        std::vector<double> sums;
    };

    bool looksInward(std::size_t part) const
    {
        bool nested = false;
        double drop = 0;
        for (const Decided& d : mDecided) {
            if (!meet(d, part)) continue;
            nested ^= mParts[d.part].box.contains(mParts[part].box) &&
                      liesWithin(mParts[part], d.winding, mPoints);
            drop += dropAcross(part, d.winding);
        }
        // Of the 1 that a surface's number drops by. [derived: 1/2 s / sqrt(s^2 + 1/(3 pi)) cells,
        // with s = 1, of a plane half a cell away, that the step across just reaches]
        constexpr double kClearly = 0.475;
        if (std::abs(drop) > kClearly) return drop < 0;
        // A twentieth of what a closed part does. [tuned: ContourNormals; the same from 0.005 to
        // 0.02]
        constexpr double kTells = 0.01;
        const double closing = closingOf(part);
        if (std::abs(closing) > kTells) return closing < 0;
        // A flat part, as the last contour below a top, is seen from behind as well.
        // [tuned: ContourNormals; the same from 0.01 to 0.04]
        constexpr double kFlat = 0.02;
        constexpr double kPerPixel = 12; // points
        const double facing = visibilityOf(mParts[part], mPoints, kPerPixel).facing;
        return std::abs(facing) > kFlat ? (facing < 0) != nested : drop < 0;
    }

    /// What a part, as it is, does to the winding number on the surfaces of all that it meets. On
    /// those of solids it is a half.
    struct Closing {
        double area = 0;   ///< of all
        double before = 0; ///< mean number, without the part
        double added = 0;  ///< by the part
        double gain = 0; ///< mean of (1/2 - number) * added: a fourth of what the square falls by,
                         ///< against the part turned

        void take(double of, const std::vector<double>& numbers, const std::vector<double>& own)
        {
            area += of;
            const double share = of / double(own.size());
            for (std::size_t i = 0; i < own.size(); ++i) {
                before += share * numbers[i];
                added += share * own[i];
                gain += share * (0.5 - numbers[i]) * own[i];
            }
        }
        /// Whether the parts then enclose something: of sheets nothing follows for each other.
        bool encloses() const
        {
            // A scan from one side comes to a sixth, a ball to 0.4. [tuned: ContourNormals,
            // EstimateNormals; the same from 0.12 to 0.25]
            constexpr double kOpen = 0.18;
            return before + (gain < 0 ? -added : added) > kOpen * area;
        }
    };

    /// The walls of a bore differ so from a part of their own, though of the faces between them
    /// and the outer ones nothing is there. @return 0 if the part encloses nothing, else below 0
    /// for inward.
    double closingOf(std::size_t part) const
    {
        if (mParts[part].points.size() < kFewestPoints) return 0;
        const PartWinding own(mParts[part], mPoints, false);
        const std::vector<double> owns = own.on(mParts[part], mPoints);
        std::vector<double> numbers(owns.size(), 0);
        Closing closing;
        for (const Decided& d : mDecided) {
            if (!meet(d, part)) continue;
            add(d.winding.on(mParts[part], mPoints), numbers);
            closing.take(d.winding.area(), d.sums, own.on(mParts[d.part], mPoints));
        }
        closing.take(own.area(), numbers, owns);
        return closing.encloses() ? closing.gain / own.area() : 0;
    }

    static void add(const std::vector<double>& values, std::vector<double>& sums)
    {
        for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += values[i];
    }

    void decide(std::size_t part, bool inward)
    {
        Decided decided{part, PartWinding(mParts[part], mPoints, inward), {}};
        decided.sums = decided.winding.on(mParts[part], mPoints);
        for (Decided& d : mDecided) {
            if (!meet(d, part)) continue;
            add(decided.winding.on(mParts[d.part], mPoints), d.sums);
            add(d.winding.on(mParts[part], mPoints), decided.sums);
        }
        mDecided.push_back(std::move(decided));
    }

    /// Whether the boxes of a decided part and another one meet, or nearly.
    bool meet(const Decided& d, std::size_t part) const
    {
        Eigen::AlignedBox3f box = mParts[d.part].box;
        constexpr double kNear = 2; // cells, a twelfth of its size; [tuned: contour_normals_test]
        box.min().array() -= float(kNear * d.winding.cell());
        box.max().array() += float(kNear * d.winding.cell());
        return box.intersects(mParts[part].box);
    }

    /// How much the winding number of another part drops from behind a part's points to before
    /// them: where the part fills a gap of the other, or lies on it, positive if it looks outward.
    double dropAcross(std::size_t part, const PartWinding& other) const
    {
        double drop = 0, count = 0;
        forAFew(mParts[part], mPoints, [&](const Vec3d& p, const Vec3d& normal) {
            const Vec3d step = other.cell() / 2 * normal;
            drop += other.at(p - step) - other.at(p + step);
            count += 1;
        });
        return drop / count;
    }

    /// Of a part that others ask. [tuned: contour_normals_test]
    static constexpr std::size_t kFewestPoints = 100;

    const std::vector<Part>& mParts;
    const OrientedParts& mPoints;
    std::vector<Decided> mDecided;
};

} // namespace

std::vector<char> findInwardParts(const OrientedParts& points, Interrupter& progress)
{
    const std::vector<Part> parts = collectParts(points);
    std::vector<std::size_t> largestFirst(parts.size());
    std::iota(largestFirst.begin(), largestFirst.end(), std::size_t(0));
    std::stable_sort(largestFirst.begin(), largestFirst.end(), [&](std::size_t x, std::size_t y) {
        return parts[x].points.size() > parts[y].points.size();
    });
    PartTurner turner(parts, points);
    std::vector<char> inward(partEnd(points), 0);
    for (const std::size_t p : largestFirst) {
        progress.check();
        inward[points.parts[parts[p].points.front()]] = turner.isInward(p);
    }
    return inward;
}

} // namespace mpuvdb
