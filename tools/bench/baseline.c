/* The datagrams of io's cycle between two C programs, without anything of a robot: what this machine allows.

   baseline HZ SECONDS CLIENT_CORE SERVER_CORE REPLY_BYTES WRITE_BYTES WAIT_NS SPIN_NS    cores: -1 for any

   The client does what io does, on absolute deadlines: query, wait, read, reply, write; the server answers reads. Prints
   cycles, deadlines missed, the median and 99 % of the time from a reply to the write behind it, and the client's CPU
   time of a cycle but for WAIT_NS; in ns. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { QUERY_BYTES = 22, READ_BYTES = 22, QUERY = 1, READ = 2, WRITE = 3, ROOM = 1 << 20, TIMEOUT_MS = 2, CLIENT_PRIORITY = 80, SERVER_PRIORITY = 70 };

static uint8_t buffer[65536];
static int64_t latencies[ROOM];

static int64_t now_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1000000000LL + now.tv_nsec;
}

static int64_t cpu_ns(void) {
  struct timespec used;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
  return used.tv_sec * 1000000000LL + used.tv_nsec;
}

static void sleep_until(int64_t when) {
  struct timespec at = {when / 1000000000LL, when % 1000000000LL};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL);
}

static void place(int core, int priority) {
  cpu_set_t cores;
  CPU_ZERO(&cores);
  CPU_SET(core < 0 ? 0 : core, &cores);
  if (core >= 0) sched_setaffinity(0, sizeof cores, &cores);
  struct sched_param wanted = {.sched_priority = priority};
  sched_setscheduler(0, SCHED_FIFO, &wanted);  /* without the right to it: as io without it */
  prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0);
}

static void say(int socket, uint8_t what, int bytes) {
  buffer[0] = what;
  send(socket, buffer, bytes, 0);
}

static void serve(int socket, int reply_bytes) {
  struct sockaddr_in from;
  for (;;) {
    socklen_t size = sizeof from;
    long got = recvfrom(socket, buffer, sizeof buffer, 0, (struct sockaddr *)&from, &size);
    if (got > 0 && buffer[0] == READ) sendto(socket, buffer, reply_bytes, 0, (struct sockaddr *)&from, size);
  }
}

static int receive(int socket, int64_t spin_ns) {
  int64_t until = now_ns() + spin_ns;
  do
    if (recv(socket, buffer, sizeof buffer, MSG_DONTWAIT) > 0) return 1;
  while (now_ns() < until);
  struct pollfd wanted = {socket, POLLIN, 0};
  return poll(&wanted, 1, TIMEOUT_MS) == 1 && recv(socket, buffer, sizeof buffer, MSG_DONTWAIT) > 0;
}

static int by_size(const void *a, const void *b) {
  int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
  return (x > y) - (x < y);
}

int main(int count, char **given) {
  if (count != 9) return 2;
  int64_t period = 1000000000LL / atoll(given[1]), seconds = atoll(given[2]);
  int reply_bytes = atoi(given[5]), write_bytes = atoi(given[6]);
  int64_t wait = atoll(given[7]), spin = atoll(given[8]), cycles = 0, missed = 0, kept = 0;
  struct sockaddr_in at = {.sin_family = AF_INET, .sin_addr = {htonl(INADDR_LOOPBACK)}};
  socklen_t size = sizeof at;
  int theirs = socket(AF_INET, SOCK_DGRAM, 0), ours = socket(AF_INET, SOCK_DGRAM, 0);
  if (bind(theirs, (struct sockaddr *)&at, sizeof at) || getsockname(theirs, (struct sockaddr *)&at, &size)
      || connect(ours, (struct sockaddr *)&at, sizeof at))
    return 1;
  pid_t server = fork();
  if (!server) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    place(atoi(given[4]), SERVER_PRIORITY);
    serve(theirs, reply_bytes);
  }
  place(atoi(given[3]), CLIENT_PRIORITY);
  int64_t deadline = now_ns() + period, end = deadline + seconds * 1000000000LL, used = cpu_ns();
  while (deadline < end) {
    sleep_until(deadline - spin);
    while (now_ns() < deadline) {}
    say(ours, QUERY, QUERY_BYTES);
    int64_t ready = now_ns() + wait;
    while (now_ns() < ready) {}
    say(ours, READ, READ_BYTES);
    int good = receive(ours, spin);
    int64_t received = now_ns();
    say(ours, WRITE, write_bytes);
    int64_t done = now_ns();
    if (good && kept < ROOM) latencies[kept++] = done - received;
    cycles++;
    deadline += period;
    if (done > deadline) {
      int64_t skipped = (done - deadline) / period + 1;
      missed += skipped;
      deadline += (skipped - 1) * period;
    }
  }
  used = cpu_ns() - used;
  kill(server, SIGKILL);
  waitpid(server, NULL, 0);
  qsort(latencies, kept, sizeof *latencies, by_size);
  printf("%lld %lld %lld %lld %lld\n", (long long)cycles, (long long)missed,
         (long long)(kept ? latencies[kept / 2] : 0), (long long)(kept ? latencies[kept * 99 / 100] : 0),
         (long long)(cycles ? used / cycles - wait : 0));
  return 0;
}
