/* Memory as x86-64 shows it to processes (total store order), for the models in this folder.
 *
 * Promela alone is sequentially consistent and would prove nothing. Here each process that stores has a store buffer, a
 * queue: a store goes in at its end, `drain` lets the oldest out into memory at any later time, a load looks into the
 * own buffer before memory, a fence waits until the own buffer is empty. A process that stores nothing needs no buffer.
 * The stores of one copy (rep movs) may pass each other: the models issue them in any order.
 *
 * kill -9: nothing more is loaded or stored, but the buffer goes on draining, for a retired store is never taken back.
 * A successor begins when it is empty: the kernel runs the end of the dead process on the same processor, and gives its
 * locks back with locked instructions, which are full fences there.
 *
 * The including file defines PROCESSES (those that store), CELLS (bytes of memory), SIZE (stores a buffer holds) and
 * ALWAYS (what must hold whenever memory has changed). AT_ONCE leaves the buffers out, to show what is missed then.
 */

typedef Buffer { byte count; byte cell[SIZE]; byte value[SIZE] };

Buffer buffer[PROCESSES];
byte memory[CELLS];
hidden byte scan;

#define EMPTY(me) (buffer[me].count == 0)

inline store(me, where, what) {
    d_step {
#ifdef AT_ONCE
        memory[where] = what;
        ALWAYS
#else
        buffer[me].count < SIZE ->
        buffer[me].cell[buffer[me].count] = where;
        buffer[me].value[buffer[me].count] = what;
        buffer[me].count++
#endif
    }
}

inline load(me, where, into) {
    d_step {
        into = memory[where];
        scan = 0;
        do
        :: scan < buffer[me].count ->
            if
            :: buffer[me].cell[scan] == where -> into = buffer[me].value[scan]
            :: else
            fi;
            scan++
        :: else -> break
        od
    }
}

inline fence(me) { EMPTY(me) }

active [PROCESSES] proctype drain() {
end:
    do
    :: d_step {
        !EMPTY(_pid) ->
        memory[buffer[_pid].cell[0]] = buffer[_pid].value[0];
        buffer[_pid].count--;
        scan = 0;
        do
        :: scan < buffer[_pid].count ->
            buffer[_pid].cell[scan] = buffer[_pid].cell[scan + 1];
            buffer[_pid].value[scan] = buffer[_pid].value[scan + 1];
            scan++
        :: else -> break
        od;
        buffer[_pid].cell[scan] = 0;
        buffer[_pid].value[scan] = 0;
        ALWAYS
    }
    od
}
