// Points and truths of the validation set, which shares no shape, no generator and no scanner with
// the library:
//     validate_clouds --list
//     validate_clouds SOLID truth RESOLUTION OUT.ply
//     validate_clouds SOLID CONDITION POINTS SEED OUT.ply
// The second writes the mesh that reconstructions are held against, the third a cloud. The same
// arguments give the same bytes.
#include "validate_rays.h"
#include "validate_solids.h"

#include <cmath>
#include <cstdio>
#include <exception>
#include <fstream>
#include <map>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

using namespace validate;

namespace
{

constexpr double kPi = 3.14159265358979323846;
constexpr int kViews = 10;

/// What is wrong with a cloud. Lengths are parts of the diagonal, and standard deviations.
struct Condition {
    bool isScanned = false;  ///< by rays from viewpoints; else evenly by area, everywhere
    double isotropic = 0;    ///< on each axis
    double alongNormal = 0;  ///< of the surface
    double alongRay = 0;     ///< of a scanner, for each point anew
    double perScan = 0;      ///< along the ray, but smooth over each scan
    double depthStep = 0;    ///< depths are multiples of it
    double misalignment = 0; ///< rigid, of each scan as a whole
    double densityRatio = 1; ///< largest by least density
    double outliers = 0;     ///< share of the points, anywhere in a box a fifth larger
    double normals = 0;      ///< degrees about each of two axes
    bool isOriented = true;  ///< has normals
    double manyTimes = 1;    ///< times the points that were asked for
};

std::map<std::string, Condition> conditions()
{
    std::map<std::string, Condition> all;
    all["exact"]; // random places, nothing else
    all["exact4"].manyTimes = 4;
    Condition& isotropic = all["noisy"];
    isotropic.isotropic = 0.002;
    isotropic.normals = 8;
    Condition& normal = all["noisy-normal"];
    normal.alongNormal = 0.002;
    normal.normals = 8;
    Condition& scanned = all["scanned"];
    scanned.isScanned = true;
    scanned.alongRay = 0.0008;
    scanned.perScan = 0.0004;
    scanned.depthStep = 0.0005;
    scanned.normals = 6;
    Condition& misaligned = all["misaligned"];
    misaligned.isScanned = true;
    misaligned.alongRay = 0.0001;
    misaligned.misalignment = 0.0004;
    misaligned.normals = 3;
    Condition& uneven = all["uneven"];
    uneven.densityRatio = 30;
    uneven.isotropic = 0.0002;
    uneven.normals = 3;
    Condition& unoriented = all["unoriented"];
    unoriented.isOriented = false;
    unoriented.isotropic = 0.0004;
    Condition& outliers = all["outliers"];
    outliers.outliers = 0.03;
    outliers.isotropic = 0.0004;
    outliers.normals = 4;
    return all;
}

/// The same numbers with every standard library.
class Random
{
public:
    explicit Random(std::uint64_t seed) : mEngine(seed) {}
    double uniform() { return std::ldexp(double(mEngine() >> 11), -53); }
    double gauss()
    {
        const double radius = std::sqrt(-2 * std::log(1 - uniform()));
        return radius * std::cos(2 * kPi * uniform());
    }
    Vec3 gauss3()
    {
        const double x = gauss(), y = gauss(), z = gauss();
        return {x, y, z};
    }

private:
    std::mt19937_64 mEngine;
};

struct Point {
    Vec3 position, normal;
};

class Cloud
{
public:
    Cloud(const Truth& truth, const Condition& condition, std::uint64_t seed)
        : mTruth(truth), mCondition(condition), mRandom(seed), mBox(truth.mesh.bounds()),
          mDiagonal(mBox.diagonal().norm())
    {
    }

    std::vector<Point> make(std::size_t count)
    {
        count = std::size_t(double(count) * mCondition.manyTimes);
        std::vector<Point> points = mCondition.isScanned ? scans(count) : places(count);
        for (Point& p : points) disturb(p);
        return points;
    }

private:
    /// Evenly by area, thinned along the diagonal where that is asked for.
    std::vector<Point> places(std::size_t count)
    {
        std::vector<double> areas;
        double sum = 0;
        for (std::size_t t = 0; t < mTruth.mesh.triangles.size(); ++t)
            areas.push_back(sum += mTruth.mesh.cross(t).norm());
        std::vector<Point> points;
        while (points.size() < count) {
            const auto found =
                std::upper_bound(areas.begin(), areas.end(), mRandom.uniform() * sum);
            const auto t = std::min(std::size_t(found - areas.begin()), areas.size() - 1);
            const Point p = placeOn(t);
            const Vec3 share = (p.position - mBox.min()).cwiseQuotient(mBox.sizes());
            if (mRandom.uniform() < std::pow(mCondition.densityRatio, -share.mean()))
                points.push_back(p);
        }
        return points;
    }

    Point placeOn(std::size_t t)
    {
        const double r = std::sqrt(mRandom.uniform()), s = mRandom.uniform();
        const Triangles& mesh = mTruth.mesh;
        const Vec3 p = (1 - r) * mesh.corner(t, 0) + r * (1 - s) * mesh.corner(t, 1) +
                       r * s * mesh.corner(t, 2);
        if (!mTruth.implicit) return {p, mesh.cross(t).normalized()};
        const Vec3 q = mTruth.implicit->project(p);
        return {q, mTruth.implicit->gradient(q).normalized()};
    }

    /// One device, and what is wrong with this scan of its.
    struct View {
        Vec3 eye, right, up, ahead;
        Eigen::Matrix3d turn = Eigen::Matrix3d::Identity(); ///< about the middle of the box
        Vec3 shift = Vec3::Zero();
        std::array<Eigen::Array3d, 4> waves; ///< two frequencies and a phase: the smooth noise
    };

    View view(const Eigen::Matrix3d& turned, int n)
    {
        const double z = 1 - (2 * n + 1.0) / kViews, angle = n * kPi * (3 - std::sqrt(5.0));
        const double side = std::sqrt(1 - z * z);
        const Vec3 towards = turned * Vec3(side * std::cos(angle), side * std::sin(angle), z);
        View v;
        v.eye = mBox.center() + 1.6 * mDiagonal * towards;
        v.ahead = -towards;
        v.right = towards.unitOrthogonal();
        v.up = towards.cross(v.right);
        // At the ends of the box, turns move points as far as shifts do.
        const double m = mCondition.misalignment;
        v.turn = Eigen::AngleAxisd(2 * m * mRandom.gauss(), mRandom.gauss3().normalized());
        v.shift = m * mDiagonal * mRandom.gauss3() / std::sqrt(3.0);
        for (Eigen::Array3d& wave : v.waves)
            wave = Eigen::Array3d(6 * mRandom.gauss(), 6 * mRandom.gauss(),
                                  2 * kPi * mRandom.uniform());
        return v;
    }

    /// From viewpoints all round, as many rays as give about @a count points.
    std::vector<Point> scans(std::size_t count)
    {
        const RayTree tree(mTruth.mesh);
        const Eigen::Matrix3d turned =
            Eigen::AngleAxisd(kPi * mRandom.uniform(), mRandom.gauss3().normalized())
                .toRotationMatrix();
        std::vector<View> views;
        for (int n = 0; n < kViews; ++n) views.push_back(view(turned, n));
        constexpr int kFew = 64;
        std::vector<Point> points;
        for (const View& v : views) look(v, kFew, tree, points);
        if (points.empty()) throw std::runtime_error("no ray meets the solid");
        const int side = int(kFew * std::sqrt(double(count) / double(points.size())));
        points.clear();
        for (const View& v : views) look(v, side, tree, points);
        return points;
    }

    /// A square image with @a side rays to a side.
    void look(const View& v, int side, const RayTree& tree, std::vector<Point>& points)
    {
        const double wide = 0.5 / 1.5; // tangent: the box's ball is within the image
        for (int row = 0; row < side; ++row)
            for (int column = 0; column < side; ++column) {
                const double x = 2 * (column + 0.5) / side - 1, y = 2 * (row + 0.5) / side - 1;
                const Vec3 ray = (v.ahead + wide * (x * v.right + y * v.up)).normalized();
                if (const auto hit = tree.first(v.eye, ray)) measure(v, x, y, ray, *hit, points);
            }
    }

    void measure(const View& v, double x, double y, const Vec3& ray, const RayTree::Hit& hit,
                 std::vector<Point>& points)
    {
        constexpr double kGrazing = 0.2; // cosine: devices get nothing back
        double depth = hit.along;
        Vec3 normal = mTruth.mesh.cross(hit.triangle).normalized();
        if (const Implicit* smooth = mTruth.implicit.get()) {
            for (int n = 0; n < 4; ++n) { // from the facet to the surface
                const Vec3 p = v.eye + depth * ray, g = smooth->gradient(p);
                if (std::abs(g.dot(ray)) > 0.1 * g.norm()) depth -= smooth->value(p) / g.dot(ray);
            }
            const Vec3 p = v.eye + depth * ray;
            constexpr double kOff = 1e-5; // world units
            if (std::abs(smooth->value(p)) > kOff) return;
            normal = smooth->gradient(p).normalized();
        }
        if (normal.dot(-ray) < kGrazing) return;
        depth += mDiagonal * mCondition.alongRay * mRandom.gauss();
        double wave = 0;
        for (const Eigen::Array3d& w : v.waves) wave += std::sin(w[0] * x + w[1] * y + w[2]);
        depth += mDiagonal * mCondition.perScan * wave / std::sqrt(2.0);
        const double step = mDiagonal * mCondition.depthStep;
        if (step > 0) depth = step * std::round(depth / step);
        const Vec3 middle = mBox.center(), p = v.eye + depth * ray;
        points.push_back({middle + v.turn * (p - middle) + v.shift, v.turn * normal});
    }

    /// What is alike for both ways to get points.
    void disturb(Point& p)
    {
        p.position += mDiagonal * mCondition.alongNormal * mRandom.gauss() * p.normal;
        p.position += mDiagonal * mCondition.isotropic * mRandom.gauss3();
        const Vec3 u = p.normal.unitOrthogonal(), v = p.normal.cross(u);
        const double spread = mCondition.normals * kPi / 180;
        p.normal += std::tan(spread * mRandom.gauss()) * u;
        p.normal += std::tan(spread * mRandom.gauss()) * v;
        p.normal.normalize();
        if (mRandom.uniform() >= mCondition.outliers) return;
        const Vec3 place(mRandom.uniform() - 0.5, mRandom.uniform() - 0.5, mRandom.uniform() - 0.5);
        p.position = mBox.center() + 1.2 * mBox.sizes().cwiseProduct(place);
        p.normal = mRandom.gauss3().normalized();
    }

    const Truth& mTruth;
    const Condition mCondition;
    Random mRandom;
    Box mBox;
    double mDiagonal;
};

template <typename T>
void put(std::ofstream& file, T value)
{
    file.write(reinterpret_cast<const char*>(&value), sizeof value);
}

std::ofstream openPly(const std::string& path, std::size_t vertices)
{
    std::ofstream file(path, std::ios::binary);
    file << "ply\nformat binary_little_endian 1.0\nelement vertex " << vertices
         << "\nproperty double x\nproperty double y\nproperty double z\n";
    return file;
}

void finish(std::ofstream& file, const std::string& path)
{
    file.close();
    if (!file) throw std::runtime_error(path + ": cannot be written; is there a folder, and room?");
}

void write(const std::string& path, const std::vector<Point>& points, bool isOriented)
{
    std::ofstream file = openPly(path, points.size());
    if (isOriented) file << "property float nx\nproperty float ny\nproperty float nz\n";
    file << "end_header\n";
    for (const Point& p : points) {
        for (const double x : p.position) put(file, x);
        if (isOriented)
            for (const double x : p.normal) put(file, float(x));
    }
    finish(file, path);
}

void write(const std::string& path, const Triangles& mesh)
{
    std::ofstream file = openPly(path, mesh.vertices.size());
    file << "element face " << mesh.triangles.size()
         << "\nproperty list uchar uint vertex_indices\nend_header\n";
    for (const Vec3& p : mesh.vertices)
        for (const double x : p) put(file, x);
    for (const auto& t : mesh.triangles) {
        put(file, std::uint8_t(3));
        for (const std::uint32_t v : t) put(file, v);
    }
    finish(file, path);
}

void list()
{
    std::printf("solids:");
    for (const std::string& name : solidNames()) std::printf(" %s", name.c_str());
    std::printf("\nconditions:");
    for (const auto& entry : conditions()) std::printf(" %s", entry.first.c_str());
    std::printf("\n");
}

void run(const std::vector<std::string>& words)
{
    const std::string usage = "validate_clouds: give --list, SOLID truth RESOLUTION OUT.ply, or "
                              "SOLID CONDITION POINTS SEED OUT.ply";
    if (words.size() == 1 && words[0] == "--list") return list();
    if (words.size() == 4 && words[1] == "truth")
        return write(words[3], makeTruth(words[0], std::stoi(words[2])).mesh);
    if (words.size() != 5) throw std::runtime_error(usage);
    const auto all = conditions();
    const auto found = all.find(words[1]);
    if (found == all.end())
        throw std::runtime_error(words[1] + ": is no condition; --list shows them");
    constexpr int kResolution = 128; // places are then put on the surface
    const Truth truth = makeTruth(words[0], kResolution);
    Cloud cloud(truth, found->second, std::stoull(words[3]));
    write(words[4], cloud.make(std::stoull(words[2])), found->second.isOriented);
}

} // namespace

int main(int argc, char** argv)
{
    try {
        run({argv + 1, argv + argc});
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
}
