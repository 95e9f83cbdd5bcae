/* The halves of io's cycle with the system calls: from the boards' reply to its check, and from control to the write;
   one after the other where Python has nothing to decide. */
#define _GNU_SOURCE
#include "fields.h"
#include "numeric.h"
#include "times.h"
#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>

enum { SIZE, RECEIVED_NS, SENT_NS };  // of what came

/* The bytes of the next datagram; UNREADABLE, or NOTHING: none in time, or a signal came before. */
static int64_t receive(const Hub *hub, int fd, int64_t timeout_ms, int64_t spin_ns) {
  int64_t until_ns = spin_ns ? time_ns(CLOCK_MONOTONIC) + spin_ns : 0, size;
  size_t room = sizeof(uint32_t) * hub->buffer;
  while ((size = recv(fd, hub->received, room, MSG_DONTWAIT)) < 0 && errno == EAGAIN
         && spin_ns && time_ns(CLOCK_MONOTONIC) < until_ns) {
  }
  if (size < 0 && errno == EAGAIN) {
    struct pollfd wanted = {.fd = fd, .events = POLLIN};
    if (poll(&wanted, 1, (int)timeout_ms) <= 0) return NOTHING;
    size = recv(fd, hub->received, room, MSG_DONTWAIT);
  }
  return size < 0 ? UNREADABLE : size;
}

/* Fresh blocks of all boards with the label of our read. */
static int is_wanted(const Exchange *k, const Hub *hub, int64_t size, int64_t tl) {
  const uint8_t *rx = (const uint8_t *)hub->received;
  return size == k->reply_bytes && rx[2] >> 2 == tl && (rx[3] & 0xF0) == BLOCK_RESPONSE << 4
         && (rx[5] & 0x3F) == k->hub_node && (rx[12] << 8 | rx[13]) == k->data_bytes && Hub_take(hub);
}

static int send_all(const Exchange *k, const Write *write, int fd, int64_t label) {
  memcpy(write->datagram, k->heads + label * k->head_bytes, k->head_bytes);
  Write_pack(write);
  int64_t size = send(fd, write->datagram, write->datagram_bytes, MSG_DONTWAIT | MSG_NOSIGNAL);
  if (size != write->datagram_bytes) return 0;
  k->came[SENT_NS] = time_ns(CLOCK_MONOTONIC);
  for (int64_t b = 0; b < write->boards; b++) write->out[(b + 1) * write->columns - 1] = 0;
  return 1;
}

/* Control and send, with SENT if that worked; nothing is sent after `over_ns`. */
int64_t Exchange_control_and_send(const Exchange *k, int64_t fd, int64_t label, double share, int64_t has_sample,
                                  int64_t over_ns) {
  int64_t bits = Io_control_and_encode((const Io *)(intptr_t)k->io, share, has_sample);
  if (time_ns(CLOCK_BOOTTIME) > over_ns) return bits;
  return send_all(k, (const Write *)(intptr_t)k->write, (int)fd, label) ? bits | SENT : bits;
}

/* Receive and check. MISSED: what came, if anything, is not what was asked for with `tl`. Without a bit, and before
   `wake_ns`, the other half follows at once, with `label` and the share that procs/io/cycle.py would take. */
int64_t Exchange_receive_and_check(const Exchange *k, int64_t fd, int64_t tl, int64_t label, int64_t timeout_ms,
                                   int64_t spin_ns, int64_t good_ns, int64_t wake_ns, int64_t over_ns, double gap_ns) {
  const Hub *hub = (const Hub *)(intptr_t)k->hub;
  int64_t size = k->came[SIZE] = receive(hub, (int)fd, timeout_ms, spin_ns);
  int64_t now_ns = k->came[RECEIVED_NS] = time_ns(CLOCK_MONOTONIC);
  if (!is_wanted(k, hub, size, tl)) return MISSED;
  int64_t bits = Io_decode_and_check((const Io *)(intptr_t)k->io);
  if (bits || now_ns >= wake_ns) return bits;
  int64_t age_ns = now_ns - good_ns < k->oldest_ns ? now_ns - good_ns : k->oldest_ns;
  gap_ns += ((double)age_ns - gap_ns) / k->gaps;
  return Exchange_control_and_send(k, fd, label, least_of(1.0, k->stable_ns / gap_ns), 1, over_ns);
}
