// Points of a cloud averaged over ever larger cells: a ball of any radius holds few of them.
#pragma once
#include "sorted_points.h"

#include <vector>

namespace mpuvdb
{

class ArrayFile;
class ArrayFileWriter;
class Interrupter;

/// Means of a cloud's points over the cells of each level of an octree. A mean's confidence is the
/// sum of its points', so that it counts for as many. Points of a cell whose normals differ much
/// are of other sheets, and have other means.
class MeanPyramid
{
public:
    /// @param finest  edge of the cells up to which the points themselves are given, world units.
    /// The same for any number of threads. @throws Interrupted.
    MeanPyramid(const SortedPoints& points, const RootCube& root, double finest,
                Interrupter& progress);

    /// The means of @a points that save() wrote to @a file, mapped. @throws InputError.
    MeanPyramid(const SortedPoints& points, const ArrayFile& file, const RootCube& root);
    /// @throws IoError.
    void save(ArrayFileWriter& file) const;

    /// The coarsest means over cells whose edge is at most @a size, world units; the points
    /// themselves where there are none.
    const SortedPoints& of(double size) const;
    const SortedPoints& points() const { return mPoints; }

private:
    const SortedPoints& mPoints;
    RootCube mRoot;
    std::vector<SortedPoints> mMeans; ///< from the finest level up
    int mFinest = 0;                  ///< level of the cells of the first
};

} // namespace mpuvdb
