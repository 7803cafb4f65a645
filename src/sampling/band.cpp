#include "band.h"

#include "core/clones.h"
#include "core/lanes.h"
#include "core/union_find.h"
#include "grid/prune.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cstring>
#include <fmt/format.h>
#include <iterator>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

/// Bound of block positions, which lie in (-kLastBlock, kLastBlock). [derived: 21 bits of packed()]
constexpr int kLastBlock = 1 << 20;
/// Memory of a block, bytes. [derived: sizes of its members, and of its entry in the index]
constexpr std::uint64_t kBlockBytes =
    sizeof(Band::Block) + sizeof(Band::Leaf) + 4 * kBlockVoxels + 64;

const std::array<Vec3i, 6> kFaces = {Vec3i(-1, 0, 0), Vec3i(1, 0, 0),  Vec3i(0, -1, 0),
                                     Vec3i(0, 1, 0),  Vec3i(0, 0, -1), Vec3i(0, 0, 1)};

bool before(const Vec3i& a, const Vec3i& b)
{
    return std::make_tuple(a[0], a[1], a[2]) < std::make_tuple(b[0], b[1], b[2]);
}

/// The bits of the voxels at a face of a block; all other bits are 0.
SignWords faceOf(const SignWords& words, int face)
{
    SignWords on{};
    if (face < 2) {
        const std::size_t x = face == 0 ? 0 : kBlockDim - 1;
        on[x] = words[x];
        return on;
    }
    const std::uint64_t mask = face == 2   ? kFirstY
                               : face == 3 ? kLastY
                               : face == 4 ? kFirstZ
                                           : kLastZ;
    for (std::size_t x = 0; x < kBlockDim; ++x) on[x] = words[x] & mask;
    return on;
}

bool any(const SignWords& words)
{
    std::uint64_t all = 0;
    for (const std::uint64_t w : words) all |= w;
    return all != 0;
}

SignWords inverted(const SignWords& words)
{
    SignWords result;
    for (std::size_t x = 0; x < kBlockDim; ++x) result[x] = ~words[x];
    return result;
}

/// Voxels with a face neighbor of the other sign. @param sides  signs of the six neighbor blocks.
SignWords flips(const SignWords& m, const std::array<SignWords, 6>& sides)
{
    SignWords f{};
    for (std::size_t x = 0; x < kBlockDim; ++x) {
        const std::uint64_t low = x > 0 ? m[x - 1] : sides[0][kBlockDim - 1];
        const std::uint64_t high = x + 1 < kBlockDim ? m[x + 1] : sides[1][0];
        const std::uint64_t down = (m[x] << 8) | (sides[2][x] >> 56);
        const std::uint64_t up = (m[x] >> 8) | (sides[3][x] << 56);
        const std::uint64_t back = ((m[x] << 1) & ~kFirstZ) | ((sides[4][x] & kLastZ) >> 7);
        const std::uint64_t front = ((m[x] >> 1) & ~kLastZ) | ((sides[5][x] & kFirstZ) << 7);
        f[x] = (m[x] ^ low) | (m[x] ^ high) | (m[x] ^ down) | (m[x] ^ up) | (m[x] ^ back) |
               (m[x] ^ front);
    }
    return f;
}

/// Find the voxels that are inside, and those in the band; set all others to the background. Values
/// below rounding become zero, so that voxels in the plane of a face are on one side of it.
MPUVDB_CLONES
void sortVoxels(BlockValues& values, float background, float rounding, SignWords& inside,
                SignWords& active)
{
    using Row = float __attribute__((vector_size(sizeof(float) * kBlockDim)));
    // The clamp of the sampler and the background may differ by a rounding.
    const float limit = background * (1 - rounding), zero = background * rounding;
    const Row far = Row{} + background;
    for (std::size_t x = 0; x < kBlockDim; ++x) {
        inside[x] = active[x] = 0;
        for (std::size_t y = 0; y < kBlockDim; ++y) {
            float* const at = &values[(x * kBlockDim + y) * kBlockDim];
            Row v;
            std::memcpy(&v, at, sizeof v);
            v = (v < zero) & (v > -zero) ? Row{} : v;
            const auto isInside = v < 0, isActive = (v < limit) & (v > -limit);
            v = isActive ? v : (isInside ? -far : far);
            std::memcpy(at, &v, sizeof v);
            inside[x] |= bitsOf(isInside) << (8 * y);
            active[x] |= bitsOf(isActive) << (8 * y);
        }
    }
}

/// The box in which the band is searched: loosely about the field's bounds, which may be
/// approximate, as values that are not distances may be small far from the zero set.
Box3d reachOf(const Box3d& box, double voxelSize, double background)
{
    constexpr double kMargin = 64; ///< beside the diagonal, voxels [tuned: sample_field_test]
    if (box.isEmpty()) return box;
    const double loose = box.diagonal().norm() + kMargin * voxelSize + background;
    return {box.min() - Vec3d::Constant(loose), box.max() + Vec3d::Constant(loose)};
}

} // namespace

std::uint64_t packed(const Vec3i& at)
{
    const auto bits = [](int v) { return std::uint64_t(v + kLastBlock) & 0x1fffff; };
    return bits(at[0]) | bits(at[1]) << 21 | bits(at[2]) << 42;
}

/// A run of unsampled blocks (x, y, z0 .. z1), with the root of its connected component.
struct Band::Gap {
    int x, y, z0, z1;
    std::uint32_t root;
    bool outer; ///< touches the border of the sampled blocks' box
};

Band::Band(const Field& field, const Lattice& lattice, double halfWidth, std::uint64_t maxBytes,
           Interrupter& progress, const std::optional<Zone>& zone)
    : mField(field), mLattice(lattice), mBackground(float(halfWidth * lattice.voxelSize)),
      mMaxBytes(maxBytes), mProgress(progress), mZone(zone),
      mReach(reachOf(field.bounds(), lattice.voxelSize, mBackground))
{
}

const Band::Block* Band::find(const Vec3i& at) const
{
    const auto found = mIndex.find(packed(at));
    return found == mIndex.end() ? nullptr : &mBlocks[found->second];
}

void Band::add(Block block)
{
    mIndex.emplace(packed(block.at), std::uint32_t(mBlocks.size()));
    mBlocks.push_back(std::move(block));
}

Band::Block Band::uniformBlock(const Vec3i& at, bool inside) const
{
    Block block{at, nullptr, {}};
    block.inside.fill(inside ? ~std::uint64_t(0) : 0);
    return block;
}

void Band::ensureLeaf(Block& block)
{
    if (block.leaf) return;
    const bool inside = block.inside[0] & 1u;
    block.leaf =
        std::make_unique<Leaf>(openvdb::Coord(block.at[0] * 8, block.at[1] * 8, block.at[2] * 8),
                               inside ? -mBackground : mBackground, false);
}

void Band::checkMemory() const
{
    if (!mMaxBytes || mBlocks.size() * kBlockBytes <= mMaxBytes) return;
    throw LimitError(fmt::format("the grid outgrows the memory limit of {:.1f} MB at {} blocks of "
                                 "voxels of size {}: use larger voxels or a larger --max-memory",
                                 double(mMaxBytes) / 1e6, mBlocks.size(), mLattice.voxelSize));
}

/// Whether the search may come to the block @a at.
bool Band::isInReach(const Vec3i& at) const
{
    return mReach.contains(
        Vec3d(mLattice.origin + kBlockDim * mLattice.voxelSize * at.cast<double>()));
}

/// @throws InputError if the search leaves its limit, beyond which it may never end.
void Band::checkReach(const Vec3i& at) const
{
    if (isInReach(at)) return;
    const Vec3d corner = mLattice.origin + kBlockDim * mLattice.voxelSize * at.cast<double>();
    const Box3d box = mField.bounds();
    throw InputError(fmt::format(
        "the surface leaves its bounds ({:.4g}, {:.4g}, {:.4g}) to ({:.4g}, {:.4g}, {:.4g}) and "
        "goes on beyond ({:.4g}, {:.4g}, {:.4g}). Give bounds, or the box that a warp moves them "
        "to, that hold the solid; or intersect it with a box",
        box.min()[0], box.min()[1], box.min()[2], box.max()[0], box.max()[1], box.max()[2],
        corner[0], corner[1], corner[2]));
}

Band::Block Band::sample(BlockSampler& sampler, const Vec3i& at) const
{
    BlockValues values;
    sampler.evaluate(at, values);
    Block block{at, nullptr, {}};
    SignWords activeWords;
    sortVoxels(values, mBackground, kRounding, block.inside, activeWords);
    Leaf::NodeMaskType active;
    for (std::size_t x = 0; x < kBlockDim; ++x)
        active.getWord<std::uint64_t>(openvdb::Index(x)) = activeWords[x];
    if (active.isOff() && (!any(block.inside) || !any(inverted(block.inside)))) return block;
    block.leaf =
        std::make_unique<Leaf>(openvdb::Coord(at[0] * 8, at[1] * 8, at[2] * 8), mBackground);
    std::copy(values.begin(), values.end(), block.leaf->buffer().data());
    block.leaf->setValueMask(active);
    return block;
}

std::size_t Band::search(std::vector<Vec3i> wave)
{
    // Regions of 4x4x4 blocks keep neighbors together, which share work in a sampler.
    const auto region = [](const Vec3i& b) { return Vec3i(b[0] >> 2, b[1] >> 2, b[2] >> 2); };
    const auto byRegion = [&](const Vec3i& a, const Vec3i& b) {
        const Vec3i ra = region(a), rb = region(b);
        return ra != rb ? before(ra, rb) : before(a, b);
    };
    const double band = double(mBackground);
    tbb::enumerable_thread_specific<std::unique_ptr<BlockSampler>> samplers(
        [&] { return mField.sampler(mLattice, band); });
    std::size_t sampled = 0;
    std::vector<Vec3i> beside;
    while (!wave.empty()) {
        for (const Vec3i& b : wave) {
            if (b.cwiseAbs().maxCoeff() >= kLastBlock)
                throw LimitError("the band runs out of the index range: use larger voxels");
            if (isKnown(b)) checkReach(b);
        }
        std::sort(wave.begin(), wave.end(), byRegion);
        wave.erase(std::unique(wave.begin(), wave.end()), wave.end());
        wave.erase(std::remove_if(wave.begin(), wave.end(),
                                  [&](const Vec3i& b) { return !isKnown(b) || find(b); }),
                   wave.end());
        sampled += wave.size();
        std::vector<Block> found(wave.size());
        const double share = wave.empty() ? 0 : 1.0 / double(wave.size());
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, wave.size(), 32),
                          [&](const tbb::blocked_range<std::size_t>& range) {
                              BlockSampler& sampler = *samplers.local();
                              for (std::size_t n = range.begin(); n < range.end(); ++n) {
                                  mProgress.check();
                                  found[n] = sample(sampler, wave[n]);
                              }
                              if (mBlocks.empty()) mProgress.advance(double(range.size()) * share);
                          });
        wave.clear();
        for (Block& block : found) {
            beside.clear();
            addNeighbors(block, beside);
            std::copy_if(beside.begin(), beside.end(), std::back_inserter(wave),
                         [&](const Vec3i& next) { return !find(next); });
            add(std::move(block));
        }
        checkMemory();
    }
    return sampled;
}

/// Add to @a blocks the neighbors of @a block that its active voxels touch.
void Band::addNeighbors(const Block& block, std::vector<Vec3i>& blocks)
{
    if (!block.leaf || block.leaf->getValueMask().isOff()) return;
    SignWords active;
    for (std::size_t x = 0; x < kBlockDim; ++x)
        active[x] = block.leaf->getValueMask().getWord<std::uint64_t>(openvdb::Index(x));
    for (int face = 0; face < 6; ++face)
        if (any(faceOf(active, face))) blocks.push_back(block.at + kFaces[std::size_t(face)]);
}

std::vector<Band::Gap> Band::findGaps() const
{
    using Column = std::array<int, 2>;
    std::vector<Vec3i> order(mBlocks.size());
    for (std::size_t n = 0; n < order.size(); ++n) order[n] = mBlocks[n].at;
    std::sort(order.begin(), order.end(), before);
    // Columns without blocks are outside. Only those beside blocks are needed.
    std::vector<Column> columns;
    int low = order.front()[2], high = low;
    for (std::size_t n = 0; n < order.size(); ++n) {
        low = std::min(low, order[n][2]);
        high = std::max(high, order[n][2]);
        const int x = order[n][0], y = order[n][1];
        if (n > 0 && order[n - 1][0] == x && order[n - 1][1] == y) continue;
        columns.insert(columns.end(), {{x, y}, {x - 1, y}, {x + 1, y}, {x, y - 1}, {x, y + 1}});
    }
    std::sort(columns.begin(), columns.end());
    columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
    --low;
    ++high;
    if (mZone) { // a column without blocks may be inside
        columns.clear();
        const BlockBox& known = mZone->known;
        for (int x = known.first[0]; x <= known.last[0]; ++x)
            for (int y = known.first[1]; y <= known.last[1]; ++y) columns.push_back({x, y});
        low = known.first[2];
        high = known.last[2];
    }
    std::vector<Gap> gaps;
    std::size_t n = 0;
    for (const auto& [x, y] : columns) {
        int z = low;
        const auto addGap = [&, x = x, y = y](int end) {
            if (z > end) return;
            const bool outer = !mZone && (z == low || end == high);
            gaps.push_back({x, y, z, end, std::uint32_t(gaps.size()), outer});
        };
        for (; n < order.size() && order[n][0] == x && order[n][1] == y; ++n) {
            addGap(order[n][2] - 1);
            z = order[n][2] + 1;
        }
        addGap(high);
    }
    return gaps;
}

/// Faces of sampled blocks at gaps: the gap blocks they touch with the signs of the face, and the
/// balance of signs by component of gaps.
struct Band::Contacts {
    struct Touch {
        Vec3i at;
        std::uint32_t root;
        bool inside, outside;
    };
    std::vector<Touch> touches;
    std::vector<std::int64_t> votes; ///< inside minus outside, by root; outer gaps: very negative
};

Band::Contacts Band::labelGaps(std::vector<Gap>& gaps) const
{
    // Columns of gaps, for lookups and for joining neighbors.
    UnionFind components(gaps.size());
    std::unordered_map<std::uint64_t, std::pair<std::uint32_t, std::uint32_t>> columns;
    for (std::uint32_t n = 0; n < gaps.size(); ++n) {
        auto& range = columns.try_emplace(packed({gaps[n].x, gaps[n].y, 0}), n, n).first->second;
        range.second = n + 1;
    }
    const auto columnAt = [&](int x, int y) -> std::pair<std::uint32_t, std::uint32_t> {
        const auto found = columns.find(packed({x, y, 0}));
        return found == columns.end() ? std::make_pair(0u, 0u) : found->second;
    };
    const auto join = [&](std::pair<std::uint32_t, std::uint32_t> a,
                          std::pair<std::uint32_t, std::uint32_t> b) {
        while (a.first < a.second && b.first < b.second) {
            const Gap &ga = gaps[a.first], &gb = gaps[b.first];
            if (ga.z0 <= gb.z1 && gb.z0 <= ga.z1) components.join(a.first, b.first);
            (ga.z1 < gb.z1 ? a.first : b.first)++;
        }
    };
    for (std::uint32_t n = 0; n < gaps.size();) {
        const auto column = columnAt(gaps[n].x, gaps[n].y);
        join(column, columnAt(gaps[n].x + 1, gaps[n].y));
        join(column, columnAt(gaps[n].x, gaps[n].y + 1));
        n = column.second;
    }
    Contacts contacts;
    contacts.votes.assign(gaps.size(), 0);
    for (std::uint32_t n = 0; n < gaps.size(); ++n) {
        gaps[n].root = components.find(n);
        if (gaps[n].outer)
            contacts.votes[gaps[n].root] = std::numeric_limits<std::int64_t>::min() / 2;
    }
    const auto gapAt = [&](const Vec3i& at) -> const Gap* {
        const auto column = columnAt(at[0], at[1]);
        const auto begin = gaps.begin() + column.first, end = gaps.begin() + column.second;
        const auto found =
            std::upper_bound(begin, end, at[2], [](int z, const Gap& g) { return z < g.z0; });
        return found == begin || std::prev(found)->z1 < at[2] ? nullptr : &*std::prev(found);
    };
    for (const Block& block : mBlocks) {
        for (int face = 0; face < 6; ++face) {
            const Vec3i at = block.at + kFaces[std::size_t(face)];
            const Gap* gap = find(at) ? nullptr : gapAt(at);
            if (!gap) continue;
            const bool inside = any(faceOf(block.inside, face)),
                       outside = any(faceOf(inverted(block.inside), face));
            contacts.votes[gap->root] += int(inside) - int(outside);
            contacts.touches.push_back({at, gap->root, inside, outside});
        }
    }
    return contacts;
}

void Band::resolveSigns()
{
    /// Largest number of rounds; a field without jumps needs one. [tuned: sample_field_test]
    constexpr int kMaxRounds = 64;
    for (int round = 0;; ++round) {
        mProgress.check();
        std::vector<Gap> gaps = findGaps();
        const Contacts contacts = labelGaps(gaps);
        std::vector<Vec3i> disputed;
        for (const Contacts::Touch& touch : contacts.touches) {
            const bool inside = contacts.votes[touch.root] > 0;
            if (inside ? touch.outside : touch.inside) disputed.push_back(touch.at);
        }
        // Whose signs win is decided by all faces of a gap, which may go on beyond the zone.
        mIsCertain &= !mZone || disputed.empty();
        if (!disputed.empty() && round < kMaxRounds) {
            search(std::move(disputed));
            continue;
        }
        for (const Gap& gap : gaps) {
            if (contacts.votes[gap.root] > 0)
                mInsideRuns.push_back({{gap.x, gap.y, gap.z0}, {gap.x, gap.y, gap.z1}});
        }
        // Blocks that are still disputed get their component's sign; closing the band adds a sheet.
        for (const Vec3i& at : disputed) {
            if (find(at)) continue;
            const bool inside =
                std::any_of(mInsideRuns.begin(), mInsideRuns.end(), [&](const auto& r) {
                    return r.first[0] == at[0] && r.first[1] == at[1] && r.first[2] <= at[2] &&
                           at[2] <= r.second[2];
                });
            add(uniformBlock(at, inside));
        }
        return;
    }
}

/// Voxels with a face neighbor of the other sign.
SignWords Band::signChanges(const Block& block) const
{
    std::array<SignWords, 6> sides;
    for (std::size_t face = 0; face < 6; ++face) {
        const Block* next = find(block.at + kFaces[face]);
        if (next) {
            sides[face] = next->inside;
        } else { // not sampled: the sign of this block's face
            const bool inside = any(faceOf(block.inside, int(face)));
            sides[face].fill(inside ? ~std::uint64_t(0) : 0);
        }
    }
    return flips(block.inside, sides);
}

void Band::close()
{
    // A block without a leaf needs one where a neighbor's face has the other sign.
    tbb::parallel_for(std::size_t(0), mBlocks.size(), [&](std::size_t n) {
        if (n % 1024 == 0) mProgress.check();
        Block& block = mBlocks[n];
        const SignWords flip = signChanges(block);
        if (!any(flip)) return;
        ensureLeaf(block);
        Leaf& leaf = *block.leaf;
        for (std::size_t x = 0; x < kBlockDim; ++x) {
            std::uint64_t missing =
                flip[x] & ~leaf.getValueMask().getWord<std::uint64_t>(openvdb::Index(x));
            for (; missing; missing &= missing - 1) {
                const auto i = openvdb::Index(x * 64 + std::size_t(__builtin_ctzll(missing)));
                const bool inside = block.inside[x] >> (i % 64) & 1u;
                leaf.setValueOn(i, (inside ? -0.99f : 0.99f) * mBackground);
            }
        }
    });
}

bool Band::hasZeroCrossing() const
{
    bool inside = false, outside = false;
    for (const Block& block : mBlocks) {
        if (!block.leaf) continue;
        inside |= any(block.inside);
        outside |= any(inverted(block.inside));
        if (inside && outside) return true;
    }
    return false;
}

openvdb::FloatTree::Ptr Band::assemble()
{
    auto tree = std::make_shared<openvdb::FloatTree>(mBackground);
    const auto coord = [](const Vec3i& b, int add) {
        return openvdb::Coord(b[0] * 8 + add, b[1] * 8 + add, b[2] * 8 + add);
    };
    for (const auto& [first, last] : mInsideRuns)
        tree->sparseFill({coord(first, 0), coord(last, 7)}, -mBackground, false);
    for (Block& block : mBlocks) {
        if (block.leaf)
            tree->addLeaf(block.leaf.release());
        else if (block.inside[0] & 1u)
            tree->addTile(1, coord(block.at, 0), -mBackground, false);
    }
    mBlocks.clear();
    mIndex.clear();
    mInsideRuns.clear();
    pruneBand(*tree);
    return tree;
}

} // namespace mpuvdb
