/* The compiled kernel: pure functions on arrays that the caller owns. No allocation, no global state, no threads.

   Each stage is compiled for the baseline instruction set and, for x86-64, once more for AVX2. Both give the same
   digits: the order of sums is written out, and products are not fused with sums. */

#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define VERSION 6 /* the same number stands in core/kernel/library.py */

EXPORT int32_t pf_version(void);
int32_t pf_version(void) { return VERSION; }

/* Several values at once: two registers of the baseline, one of AVX. */
typedef double v4d __attribute__((vector_size(32)));
typedef float v8f __attribute__((vector_size(32)));
typedef int16_t v8s __attribute__((vector_size(16)));
typedef int32_t v8i __attribute__((vector_size(32)));
typedef uint8_t v16b __attribute__((vector_size(16)));

#include "tables.h"

#define STAGE(name) pf_##name
#include "stages.h"
#undef STAGE

#if defined(__x86_64__) && defined(__clang__)
#include <cpuid.h>

#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#define STAGE(name) pf_##name##_avx2
#include "stages.h"
#undef STAGE
#pragma clang attribute pop

/* Whether processor and operating system have AVX2. */
static int32_t has_avx2(void) {
  unsigned a, b, c, d, low, high;
  if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_OSXSAVE)) return 0;
  __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
  return (low & 6) == 6 && __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & bit_AVX2) != 0;
}
#else
static int32_t has_avx2(void) { return 0; }
#endif

/* Whether the variants of the stages whose names end in _avx2 can be called. */
EXPORT int32_t pf_is_wide(void);
int32_t pf_is_wide(void) { return has_avx2(); }
