// Contours as SVG.
#include "files/atomic_file.h"
#include "io/meshes/mesh_formats.h"
#include <mpuvdb/contours.h>
#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;

/// The page: millimeters of the plane, whose second axis points up where SVG's points down.
class Page
{
public:
    Page(const Box3d& bounds, const SlicePlane& plane, double metersPerUnit)
        : mScale(1000 * metersPerUnit)
    {
        // What lines need to be seen whole. [derived: their width is far less]
        constexpr double kMargin = 0.01;
        Eigen::Vector2d low(0, 0), high(1, 1);
        if (!bounds.isEmpty()) {
            low = {bounds.min()[plane.firstAxis()], bounds.min()[plane.secondAxis()]};
            high = {bounds.max()[plane.firstAxis()], bounds.max()[plane.secondAxis()]};
        }
        const double margin = kMargin * (high - low).maxCoeff();
        mOrigin = {low.x() - margin, high.y() + margin};
        mSize = mScale * ((high - low).array() + 2 * margin).matrix();
        // Digits to a millionth of the page. [derived: finer than any device]
        mDigits = std::clamp(int(std::ceil(6 - std::log10(mSize.maxCoeff()))), 0, 12);
    }

    std::string head() const
    {
        return fmt::format("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.{2}f}mm\" "
                           "height=\"{1:.{2}f}mm\" viewBox=\"0 0 {0:.{2}f} {1:.{2}f}\">\n",
                           mSize.x(), mSize.y(), mDigits);
    }

    /// The closed path of a contour. Vertices that do not differ in what is written are one:
    /// there are such at corners, and readers stumble over segments without length.
    std::string path(const Contour& contour) const
    {
        std::vector<std::string> points;
        for (const Eigen::Vector2d& p : contour.points)
            if (std::string here = point(p); points.empty() || here != points.back())
                points.push_back(std::move(here));
        while (points.size() > 1 && points.back() == points.front()) points.pop_back();
        return fmt::format("M{} Z", fmt::join(points, " L"));
    }

    double millimeters(double length) const { return mScale * length; }
    double lineWidth() const { return mSize.maxCoeff() / 1000; }

private:
    std::string point(const Eigen::Vector2d& p) const
    {
        return fmt::format("{:.{}f} {:.{}f}", mScale * (p.x() - mOrigin.x()), mDigits,
                           mScale * (mOrigin.y() - p.y()), mDigits);
    }

    double mScale; ///< millimeters per world unit
    Eigen::Vector2d mOrigin, mSize;
    int mDigits = 0;
};

} // namespace

void writeContours(const fs::path& file, const std::vector<Slice>& slices, int axis,
                   const Box3d& bounds, double metersPerUnit, Interrupter* interrupter)
{
    const Interrupter& progress = orSilent(interrupter);
    if (axis < 0 || axis > 2)
        throw UsageError(fmt::format("slice: axis is {}, and must be 0, 1 or 2", axis));
    requireScene({UpAxis::Y, metersPerUnit});
    const Page page(bounds, {axis, 0}, metersPerUnit);
    writeStream(file, [&](OutputBuffer& out) {
        out.text("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n" + page.head());
        for (const Slice& slice : slices) {
            out.text(fmt::format("<g data-axis=\"{}\" data-height=\"{:.9g}\" fill=\"#d8d8d8\" "
                                 "fill-rule=\"evenodd\" stroke=\"#000000\" stroke-width=\"{:.3g}\">"
                                 "\n<path d=\"",
                                 "xyz"[axis], page.millimeters(slice.height), page.lineWidth()));
            for (const Contour& contour : slice.contours) {
                progress.check();
                if (!contour.points.empty()) out.text(page.path(contour) + "\n");
            }
            out.text("\"/>\n</g>\n");
        }
        out.text("</svg>\n");
    });
}

} // namespace mpuvdb
