/* The datagrams of a broadcast cycle: procs/io/bus/rows.py (Hub) and procs/io/bus/protocols.py (Write). */
#include "fields.h"
#include <string.h>

enum { DATA_AT = 22 };  // bytes before the data of a block write

static uint32_t table[256];

__attribute__((constructor)) static void fill_table(void) {
  for (uint32_t byte = 0; byte < 256; byte++) {
    uint32_t crc = byte << 24;
    for (int bit = 0; bit < 8; bit++) crc = crc & 0x80000000u ? crc << 1 ^ 0x04C11DB7u : crc << 1;
    table[byte] = crc;
  }
}

static void put(uint8_t *at, uint32_t word) {
  word = __builtin_bswap32(word);
  memcpy(at, &word, sizeof word);
}

/* CRC-32, most significant bit first (procs/fpga/wire.py), behind what it is of. */
static void put_crc(uint8_t *data, int64_t bytes) {
  uint32_t crc = 0xFFFFFFFFu;
  for (int64_t i = 0; i < bytes; i++) crc = crc << 8 ^ table[crc >> 24 ^ data[i]];
  put(data + bytes, ~crc);
}

int64_t Hub_expect(const Hub *k, int64_t sequence) {
  uint32_t header = __builtin_bswap32((uint32_t)((sequence & k->sequence_mask) << k->sequence_shift));
  for (int64_t i = 0; i < k->members; i++) k->expected[2 * i] = k->sizes[i] | header;
  return 0;
}

/* The query's datagram; what answers it is expected from now on. */
int64_t Hub_ask(const Hub *k, int64_t sequence, int64_t tl, int64_t generation) {
  uint8_t *at = k->query;
  at[0] = 0;
  at[1] = (uint8_t)generation;
  put(at + 2, 0xFFFF0000u | (uint32_t)tl << 10);
  put(at + 6, (uint32_t)HOST_ID << 16);
  put(at + 10, QUERY);
  put(at + 14, (uint32_t)(sequence << 16 | k->mask_of_boards));
  put_crc(at + 2, 16);
  return Hub_expect(k, sequence);
}

/* 1: every board's block is the wanted one, and lies in its row now. */
int64_t Hub_take(const Hub *k) {
  for (int64_t i = 0; i < 2 * k->members; i++) k->masked[i] = k->received[k->heads[i]] & k->check[i];
  if (memcmp(k->masked, k->expected, 2 * sizeof(uint32_t) * k->members)) return 0;
  for (int64_t i = 0; i < k->quads; i++) k->blocks[k->taken_to[i]] = __builtin_bswap32(k->received[k->taken_from[i]]);
  memcpy(k->bad, k->away, k->boards);
  *k->last = k->received[*k->last_at];
  return 1;
}

/* Rev 7 has the board id where later ones have the mode, and amplifier enables in the control word. */
static void rev_7(const Write *k, int64_t board, uint32_t *row) {
  int64_t last = k->columns - 1;
  for (int64_t i = 0; i < last; i++) {
    row[last] |= (row[i] >> 28 & 1) << (CONTROL_AMP_SHIFT + i) | (row[i] >> 29 & 1) << (CONTROL_AMP_MASK_SHIFT + i);
    row[i] = (row[i] & DAC_KEPT) | k->board_ids[board] << DAC_BOARD_SHIFT;
  }
}

/* The commands of all boards into the datagram, and the CRC of its data. */
int64_t Write_pack(const Write *k) {
  uint32_t rows[k->boards * k->columns + 1];
  memcpy(rows, k->out, sizeof(uint32_t) * k->boards * k->columns);
  if (k->is_rev_7)
    for (int64_t b = 0; b < k->boards; b++) rev_7(k, b, rows + b * k->columns);
  for (int64_t i = 0; i < k->quads; i++) put(k->datagram + DATA_AT + 4 * k->packed_to[i], rows[k->packed_from[i]]);
  put_crc(k->datagram + DATA_AT, k->length);
  return 0;
}
