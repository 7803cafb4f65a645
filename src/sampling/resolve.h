// What the options of a reconstruction come to.
#pragma once
#include <mpuvdb/reconstruct.h>

namespace mpuvdb
{

/// Derive what @a options leave open from @a cloud, whose points have @a statistics.
/// @throws UsageError, InputError (a mesh whose vertices do not show its surface), LimitError.
ResolvedSettings resolve(const PointCloud& cloud, const PointStatistics& statistics,
                         const ReconstructOptions& options);

} // namespace mpuvdb
