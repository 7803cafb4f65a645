// Reconstructions of points as they are.
#pragma once
#include <mpuvdb/reconstruct.h>

namespace mpuvdb::test
{

/// Options without the cleaning that the door begins with.
struct Uncleaned : ReconstructOptions {
    Uncleaned() { clean.reset(); }
};

} // namespace mpuvdb::test
