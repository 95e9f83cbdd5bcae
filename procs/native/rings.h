/* The newest record of a ring, and cells of shared memory: see shm/ring/ring.py. */
#pragma once
#include <stdint.h>
#include <string.h>

enum { RETRIES = 16 };

static inline uint64_t loaded(int64_t address) {
  return __atomic_load_n((const uint64_t *)(intptr_t)address, __ATOMIC_ACQUIRE);
}

/* Into the private copy, unless that has it already; 0: there is none, or Python has to look at it. */
static inline int read_newest(int64_t head, int64_t slots, int64_t depth, int64_t stride, int64_t size, int64_t *seen,
                              uint8_t *record) {
  for (int tries = 0; tries < RETRIES; tries++) {
    int64_t n = (int64_t)loaded(head), has;  // R1
    if (n < *seen || n <= 0) return 0;
    int64_t slot = slots + n % depth * stride;
    memcpy(&has, record, sizeof has);
    if (n == *seen && has == n && (int64_t)loaded(slot) == n) return 1;
    memcpy(record, (const uint8_t *)(intptr_t)slot, size);  // R2
    __atomic_thread_fence(__ATOMIC_ACQUIRE);
    if (__atomic_load_n((const int64_t *)(intptr_t)slot, __ATOMIC_RELAXED) == n) {  // R3
      *seen = n;
      return 1;
    }
  }
  return 0;
}

static inline int64_t stamp_of(const uint8_t *record) {
  int64_t stamp;
  memcpy(&stamp, record + sizeof stamp, sizeof stamp);
  return stamp;
}
