// Functions compiled for several instruction sets; the best is chosen when the program starts.
#pragma once

/// Attributes before a function's definition. Without contraction to FMA every clone computes the
/// same bits. MPUVDB_WIDE_CLONES is for loops that gain from 32 registers, or from wider ones.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__SANITIZE_THREAD__) &&                   \
    !defined(__SANITIZE_ADDRESS__)
#define MPUVDB_CLONES __attribute__((target_clones("avx2", "default")))
#define MPUVDB_WIDE_CLONES __attribute__((target_clones("arch=x86-64-v4", "avx2", "default")))
#else
#define MPUVDB_CLONES
#define MPUVDB_WIDE_CLONES
#endif
