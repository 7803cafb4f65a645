// The processor's features as the choice of kernels sees them (core/clones.h), in place of what
// libgcc finds: linked into a test, it runs the kernels of a smaller instruction set than the
// machine's. MPUVDB_FEATURES are bits of libgcc's processor_features: 1 << 10 is AVX2, 0 leaves
// SSE2.
extern "C" {
struct {
    unsigned vendor, type, subtype, features;
} __cpu_model = {1, 0, 0, MPUVDB_FEATURES};
unsigned __cpu_features2[8] = {};
int __cpu_indicator_init()
{
    return 0;
}
}
