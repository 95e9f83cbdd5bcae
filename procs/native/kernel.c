/* What procs/native/library.py checks before it believes the library. */
#include "fields.h"

const int64_t kernel_hash = KERNEL_HASH;
const int64_t kernel_sizes[] = {KERNEL_SIZES};
