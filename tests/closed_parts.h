// Closed meshes, and what can be said of many of them together by looking at every triangle.
#pragma once
#include "modelling_fixture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <vector>

namespace mpuvdb::test
{

/// A mesh over a grid of parameters that closes both ways.
inline Mesh sweptMesh(std::uint32_t around, std::uint32_t across,
                      const std::function<Vec3d(double, double)>& place)
{
    Mesh mesh;
    for (std::uint32_t i = 0; i < around; ++i)
        for (std::uint32_t j = 0; j < across; ++j) {
            mesh.positions.push_back(
                place(2 * M_PI * i / around, 2 * M_PI * j / across).cast<float>());
            const auto at = [&](std::uint32_t m, std::uint32_t n) {
                return m % around * across + n % across;
            };
            mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
            mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
        }
    return mesh;
}

inline Mesh boxPart(const Vec3d& low, const Vec3d& high)
{
    Mesh mesh;
    for (int i = 0; i < 8; ++i)
        mesh.positions.push_back(
            Vec3d(i & 1 ? high[0] : low[0], i & 2 ? high[1] : low[1], i & 4 ? high[2] : low[2])
                .cast<float>());
    const std::array<std::array<std::uint32_t, 4>, 6> faces = {
        {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}};
    for (const auto& f : faces) {
        mesh.triangles.push_back({f[0], f[1], f[2]});
        mesh.triangles.push_back({f[0], f[2], f[3]});
    }
    return mesh;
}

inline Mesh torusPart(double major, double minor, std::uint32_t around, std::uint32_t tube)
{
    return sweptMesh(around, tube, [=](double a, double b) {
        const double rho = major + minor * std::cos(b);
        return Vec3d(rho * std::cos(a), rho * std::sin(a), minor * std::sin(b));
    });
}

/// A box whose middle rows and columns are pushed out onto a ball.
inline Mesh ballPart(double radius, int steps)
{
    Mesh mesh;
    const auto edge = std::uint32_t(steps + 1);
    for (int face = 0; face < 6; ++face) {
        const auto first = std::uint32_t(mesh.positions.size());
        const int axis = face / 2;
        for (std::uint32_t i = 0; i < edge; ++i)
            for (std::uint32_t j = 0; j < edge; ++j) {
                Vec3d p;
                p[axis] = face % 2 ? 1 : -1;
                p[(axis + 1) % 3] = 2.0 * i / steps - 1;
                p[(axis + 2) % 3] = 2.0 * j / steps - 1;
                mesh.positions.push_back((radius * p.normalized()).cast<float>());
                if (i + 1 == edge || j + 1 == edge) continue;
                std::array<std::uint32_t, 4> q = {first + i * edge + j, first + (i + 1) * edge + j,
                                                  first + (i + 1) * edge + j + 1,
                                                  first + i * edge + j + 1};
                if (face % 2 == 0) std::swap(q[1], q[3]);
                mesh.triangles.push_back({q[0], q[1], q[2]});
                mesh.triangles.push_back({q[0], q[2], q[3]});
            }
    }
    return mesh;
}

/// A pipe: the wall between two cylinders.
inline Mesh pipePart(double outer, double inner, double length, std::uint32_t around)
{
    return sweptMesh(around, 4, [=](double a, double b) {
        const int corner = int(std::lround(b / (M_PI / 2))); // 0 outer low, 1 outer high, ...
        const double rho = corner == 0 || corner == 1 ? outer : inner;
        const double z = corner == 1 || corner == 2 ? length / 2 : -length / 2;
        return Vec3d(rho * std::cos(a), rho * std::sin(a), z);
    });
}

/// A tube along a trefoil knot.
inline Mesh knotPart(double size, double tube, std::uint32_t around, std::uint32_t across)
{
    const auto spine = [=](double a) {
        return Vec3d(size *
                     Vec3d(std::sin(a) + 2 * std::sin(2 * a), std::cos(a) - 2 * std::cos(2 * a),
                           -std::sin(3 * a)) /
                     3);
    };
    return sweptMesh(around, across, [=](double a, double b) {
        const Vec3d along = (spine(a + 1e-4) - spine(a - 1e-4)).normalized();
        const Vec3d side = along.cross(Vec3d::UnitZ()).normalized(), up = side.cross(along);
        return Vec3d(spine(a) + tube * (std::cos(b) * side + std::sin(b) * up));
    });
}

inline void turnInward(Mesh& mesh)
{
    for (Mesh::Triangle& t : mesh.triangles) std::swap(t[1], t[2]);
}

inline void move(Mesh& mesh, const Eigen::Matrix3d& linear, const Vec3d& by)
{
    for (Vec3f& p : mesh.positions) p = (linear * p.cast<double>() + by).cast<float>();
}

/// All triangles, each with three vertices of its own.
inline Mesh soupOf(const std::vector<Mesh>& parts)
{
    Mesh soup;
    for (const Mesh& part : parts)
        for (const Mesh::Triangle& t : part.triangles) {
            const auto first = std::uint32_t(soup.positions.size());
            for (const std::uint32_t corner : t) soup.positions.push_back(part.positions[corner]);
            soup.triangles.push_back({first, first + 1, first + 2});
        }
    return soup;
}

/// The winding number of @a mesh about @a p, relative to its frame, by the solid angle of every
/// triangle.
inline double windingOf(const Mesh& mesh, const Vec3d& p)
{
    double angle = 0;
    for (const Mesh::Triangle& t : mesh.triangles) {
        const Vec3d a = mesh.positions[t[0]].cast<double>() - p,
                    b = mesh.positions[t[1]].cast<double>() - p,
                    c = mesh.positions[t[2]].cast<double>() - p;
        const double above = a.dot(b.cross(c));
        const double below = a.norm() * b.norm() * c.norm() + a.dot(b) * c.norm() +
                             b.dot(c) * a.norm() + c.dot(a) * b.norm();
        angle += 2 * std::atan2(above, below);
    }
    return angle / (4 * M_PI);
}

/// The place on a triangle that is nearest to @a p.
inline Vec3d nearestOn(const std::array<Vec3d, 3>& t, const Vec3d& p)
{
    const Vec3d normal = (t[1] - t[0]).cross(t[2] - t[0]);
    Vec3d best = t[0];
    bool isOver = true;
    for (std::size_t k = 0; k < 3; ++k) {
        const Vec3d &a = t[k], &b = t[(k + 1) % 3];
        isOver = isOver && normal.cross(b - a).dot(p - a) >= 0;
        const double share = std::clamp((p - a).dot(b - a) / (b - a).squaredNorm(), 0.0, 1.0);
        const Vec3d at = a + share * (b - a);
        if ((at - p).squaredNorm() < (best - p).squaredNorm()) best = at;
    }
    return isOver ? Vec3d(p - normal.dot(p - t[0]) / normal.squaredNorm() * normal) : best;
}

} // namespace mpuvdb::test
