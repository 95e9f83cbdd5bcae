/* What procs/native/library.py checks before it believes the library. */
#include "fields.h"

const int64_t native_hash = NATIVE_HASH;
const int64_t native_sizes[] = {NATIVE_SIZES};
