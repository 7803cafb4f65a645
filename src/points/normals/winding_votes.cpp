#include "winding_votes.h"

#include "core/parallel_each.h"
#include "point_winding.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

namespace mpuvdb
{
namespace
{

constexpr std::size_t kSampleGrain = 16; // samples; [free: the same votes]
/// A distance of the number from a half that is clear. [derived: half of what lies between right,
/// which is 0, and undecided]
constexpr float kClearlyOff = 0.25f;

/// What the number at a point says of its normal.
enum Saying : char { kRight, kUnclear, kWrong };

Saying sayingOf(float number)
{
    const float off = std::abs(number - 0.5f);
    return off <= kClearlyOff ? kRight : off < 1 - kClearlyOff ? kUnclear : kWrong;
}

/// What the winding number says of all points.
struct Windings {
    std::vector<float> numbers; ///< of each point
    std::vector<char> sayings;  ///< of each point
    bool reversed = false;      ///< whether they are those of all normals turned
};

Windings windingsOn(const OrientedParts& points, const std::vector<float>& areas, float noise,
                    Interrupter& progress)
{
    Windings windings;
    const std::vector<Part> parts = collectParts(points);
    const std::vector<float> on = PointWinding(parts, points, areas, noise).onPoints(progress);
    windings.numbers.resize(on.size());
    auto number = on.begin();
    for (const Part& part : parts)
        for (const std::uint32_t i : part.points) windings.numbers[i] = *number++;
    windings.reversed = std::inner_product(windings.numbers.begin(), windings.numbers.end(),
                                           areas.begin(), 0.0) < 0;
    for (float& each : windings.numbers) {
        if (windings.reversed) each = -each;
        windings.sayings.push_back(sayingOf(each));
    }
    return windings;
}

/// Points of a part of which neighbors say the same, and the number as well.
struct Piece {
    std::vector<std::uint32_t> points;
    double area = 0;         ///< world units squared
    std::vector<float> does; ///< its part of the number at each sample; empty: it is too small
};

/// Points of the smallest piece that is turned, of so many in all.
std::size_t fewestOf(std::size_t points)
{
    // Pieces. [derived: smaller ones are known by what neighbors say of them]
    constexpr std::size_t kMost = 64;
    return std::max(points / kMost, std::size_t(kPointsPerCell));
}

/// The largest pieces. @param pieceOf  of each point.
std::vector<Piece> largestPieces(const std::vector<std::uint32_t>& pieceOf,
                                 const std::vector<float>& areas)
{
    std::vector<std::uint32_t> points(pieceOf.size());
    std::iota(points.begin(), points.end(), 0u);
    std::stable_sort(points.begin(), points.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return pieceOf[a] < pieceOf[b]; });
    std::vector<Piece> largest;
    for (auto begin = points.begin(), end = begin; begin != points.end(); begin = end) {
        end = std::find_if(begin, points.end(),
                           [&](std::uint32_t i) { return pieceOf[i] != pieceOf[*begin]; });
        if (std::size_t(end - begin) < fewestOf(points.size())) continue;
        Piece piece;
        piece.points.assign(begin, end);
        for (const std::uint32_t i : piece.points) piece.area += double(areas[i]);
        largest.push_back(std::move(piece));
    }
    return largest;
}

/// Points that numbers are compared at.
struct Samples {
    std::vector<std::uint32_t> points;
    std::vector<double> areas; ///< that each stands for, world units squared
    std::vector<float> off;    ///< the number at each, less a half
};

Samples samplesOf(const std::vector<float>& areas, const std::vector<float>& numbers)
{
    // [derived: shares of the area are known to a fiftieth]
    constexpr std::size_t kMost = 2048;
    const std::size_t count = numbers.size(), some = std::min(kMost, count);
    Samples samples;
    for (std::size_t s = 0; s < some; ++s) {
        const std::size_t i = s * count / some;
        samples.points.push_back(std::uint32_t(i));
        samples.areas.push_back(double(areas[i]) * double(count) / double(some));
        samples.off.push_back(numbers[i] - 0.5f);
    }
    return samples;
}

/// The number's squared distance from a half, summed over the surface.
double misfitOf(const std::vector<double>& areas, const std::vector<float>& off)
{
    double sum = 0;
    for (std::size_t s = 0; s < off.size(); ++s) sum += areas[s] * double(off[s]) * double(off[s]);
    return sum;
}

/// By how much the misfit has to fall, as a share of the piece's area.
/// [derived: a piece that alone looks the wrong way makes 1, and half of it where half of what it
/// borders does as well; at an open rim, where the number is halfway to one that says nothing, up
/// to a quarter: the middle of the two]
constexpr double kLeastGain = 0.375;

/// Which pieces are turned, and what the winding number at the samples then is.
class Turning
{
public:
    Turning(const Samples& samples, const std::vector<Piece>& pieces)
        : mSamples(samples), mPieces(pieces), mOff(samples.off), mTurned(pieces.size(), 0)
    {
    }

    double misfit() const { return misfitOf(mSamples.areas, mOff); }

    void turn(std::size_t piece)
    {
        for (std::size_t s = 0; s < mPieces[piece].does.size(); ++s) mOff[s] -= changeBy(piece, s);
        mTurned[piece] ^= 1;
    }

    /// Turn that piece which the misfit falls most by, again and again, as long as it falls
    /// clearly.
    void descend()
    {
        for (std::size_t best = 0; best < mPieces.size();) {
            best = mPieces.size();
            double most = 0;
            for (std::size_t p = 0; p < mPieces.size(); ++p) {
                const double gain = gainOf(p);
                if (gain <= std::max(most, kLeastGain * mPieces[p].area)) continue;
                best = p;
                most = gain;
            }
            if (best < mPieces.size()) turn(best);
        }
    }

    bool isTurned(std::size_t piece) const { return mTurned[piece] != 0; }
    bool isAnyTurned() const
    {
        return std::find(mTurned.begin(), mTurned.end(), 1) != mTurned.end();
    }

    /// Whether the number is right on most of a piece. @param pieces  of each point.
    bool isRight(std::size_t piece, const std::vector<std::uint32_t>& pieces) const
    {
        const std::uint32_t name = pieces[mPieces[piece].points.front()];
        double balance = 0;
        for (std::size_t s = 0; s < mOff.size(); ++s) {
            if (pieces[mSamples.points[s]] != name) continue;
            const bool right = std::abs(mOff[s]) <= kClearlyOff;
            balance += right ? mSamples.areas[s] : -mSamples.areas[s];
        }
        return balance > 0;
    }

private:
    /// What the number at a sample falls by if a piece is turned.
    float changeBy(std::size_t piece, std::size_t sample) const
    {
        const float twice = 2 * mPieces[piece].does[sample];
        return isTurned(piece) ? -twice : twice;
    }
    /// What the misfit falls by.
    double gainOf(std::size_t piece) const
    {
        double gain = 0;
        for (std::size_t s = 0; s < mPieces[piece].does.size(); ++s) {
            const auto change = double(changeBy(piece, s));
            gain += mSamples.areas[s] * change * (2 * double(mOff[s]) - change);
        }
        return gain;
    }

    const Samples& mSamples;
    const std::vector<Piece>& mPieces;
    std::vector<float> mOff; ///< the number less a half, at each sample
    std::vector<char> mTurned;
};

/// The better of what is found from the pieces as they are, and from all that are wrong turned.
/// @param sayings  of each point.
Turning bestTurning(const Samples& samples, const std::vector<Piece>& pieces,
                    const std::vector<char>& sayings)
{
    Turning best(samples, pieces), other = best;
    for (std::size_t p = 0; p < pieces.size(); ++p)
        if (sayings[pieces[p].points.front()] == kWrong) other.turn(p);
    best.descend();
    other.descend();
    return other.misfit() < best.misfit() ? other : best;
}

/// Gathers votes.
class Voting
{
public:
    Voting(const OrientedParts& points, const std::vector<float>& areas, double noise,
           const NeighborVotes& neighbors, Interrupter& progress)
        : mPoints(points), mAreas(areas), mNoise(float(noise)), mNeighbors(neighbors),
          mProgress(progress), mWindings(windingsOn(points, areas, mNoise, progress))
    {
        const std::size_t count = points.positions.size();
        mVotes.firstPart = count + 1; // after the points and the scanners
        mVotes.nodes = mVotes.firstPart + partEnd(points);
        const Samples samples = samplesOf(areas, mWindings.numbers);
        mVotes.misfit = misfitOf(samples.areas, samples.off);
        for (const char saying : mWindings.sayings) mVotes.unclosed += saying != kRight ? 1 : 0;
        const std::vector<Piece> pieces = piecesAt(samples);
        const Turning turning = bestTurning(samples, pieces, mWindings.sayings);
        if (turning.isAnyTurned())
            votePieces(pieces, turning);
        else
            votePoints();
        mVotes.done = mVotes.against < fewestOf(count);
    }

    WindingVotes votes() && { return std::move(mVotes); }

private:
    /// The largest pieces; none where not even one of them may be the wrong way round.
    std::vector<Piece> piecesAt(const Samples& samples)
    {
        const std::size_t count = mPoints.positions.size();
        const double area = std::accumulate(samples.areas.begin(), samples.areas.end(), 0.0);
        const double share = double(fewestOf(count)) / double(count);
        if (mVotes.misfit < kLeastGain * share * area) return {};
        mPieceOf =
            agreeingPieces(mNeighbors.links, mNeighbors.turned, mWindings.sayings, mProgress);
        std::vector<Piece> pieces = largestPieces(mPieceOf, mAreas);
        for (Piece& piece : pieces)
            if (kLeastGain * piece.area < mVotes.misfit) measure(piece, samples);
        return pieces;
    }

    void votePoints()
    {
        for (std::uint32_t i = 0; i < mWindings.sayings.size(); ++i)
            if (mWindings.sayings[i] != kUnclear)
                vote(i, mWindings.sayings[i] == kWrong, mVotes.links);
    }

    void votePieces(const std::vector<Piece>& pieces, const Turning& turning)
    {
        for (std::size_t p = 0; p < pieces.size(); ++p) {
            const bool turned = turning.isTurned(p);
            if (!turned && !turning.isRight(p, mPieceOf)) continue;
            const char saying = mWindings.sayings[pieces[p].points.front()];
            for (const std::uint32_t i : pieces[p].points)
                vote(i, turned, turned || saying != kUnclear ? mVotes.links : mVotes.unclear);
        }
    }

    void measure(Piece& piece, const Samples& samples) const
    {
        const Part part{piece.points, boxOf(piece.points, mPoints)};
        const PointWinding winding({part}, mPoints, mAreas, mNoise);
        piece.does.resize(samples.points.size());
        forEachParallel(piece.does.size(), kSampleGrain, mProgress, [&](std::size_t s) {
            const float number = winding.at(mPoints.positions[samples.points[s]]);
            piece.does[s] = mWindings.reversed ? -number : number;
        });
    }

    void vote(std::uint32_t point, bool turned, std::vector<OrientationLink>& links)
    {
        const auto node = std::uint32_t(mVotes.firstPart) + mPoints.parts[point];
        const bool asItWas = turned == bool(mNeighbors.turned[point]);
        links.push_back({asItWas ? 1.f : -1.f, false, point, node});
        mVotes.against += turned ? 1 : 0;
    }

    const OrientedParts& mPoints;
    const std::vector<float>& mAreas;
    float mNoise;
    const NeighborVotes& mNeighbors;
    Interrupter& mProgress;
    Windings mWindings;
    std::vector<std::uint32_t> mPieceOf; ///< of each point; empty: not needed
    WindingVotes mVotes;
};

} // namespace

WindingVotes windingVotes(const OrientedParts& points, const std::vector<float>& areas,
                          double noise, const NeighborVotes& neighbors, Interrupter& progress)
{
    return Voting(points, areas, noise, neighbors, progress).votes();
}

} // namespace mpuvdb
