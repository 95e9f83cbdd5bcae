/* shm/doorbell.py: one ringer, and a waiter at each of two places. The one at place 1 may be killed at every step,
 * asleep too, and may have a successor. No wait ends by time here: a wake-up lost is a sleep without end.
 *
 * The kernel's part: a futex wait compares and falls asleep in one step; wait, wake, lock and unlock are full fences.
 * UNHEARD is 1 instead of 16, so that a living waiter is suspected whenever it can be.
 */

#ifndef RINGS
#define RINGS 2         /* with data; then UNHEARD more, for the dead */
#endif
#ifndef LIVES
#define LIVES 2         /* at place 1 */
#endif
#ifndef UNHEARD
#define UNHEARD 1
#endif
#ifndef SIZE
#define SIZE 3
#endif
#define PLACES 2
#define RINGER 2        /* a waiter's buffer goes by its place */
#define PROCESSES 3
#define DATA 0
#define FLAG(place) (1 + (place))
#define COUNTER(place) (3 + (place))
#define CELLS 5
#define HEEDED(place) (!asleep[place] || memory[FLAG(place)])
#define ALWAYS assert(HEEDED(0) && HEEDED(1))

bool asleep[PLACES];
bool locked[PLACES];
byte ended;             /* waiters that have seen all, or are dead and have no successor */

#include "tso.pml"

active proctype ringer() {
    byte data, place, number, unheard[PLACES];
    bool heard;
ring:
    if
    :: data < RINGS ->
        data++;
        store(RINGER, DATA, data)               /* E1 */
    :: else ->
        if
        :: ended == PLACES
        :: timeout -> assert(!asleep[0] && !asleep[1])
        fi;
        data++
    fi;
#ifndef NO_E2
    fence(RINGER);                              /* E2 */
#endif
    place = 0;
    do
    :: place < PLACES ->
        load(RINGER, FLAG(place), number);      /* E3 */
        if
        :: number ->
            load(RINGER, COUNTER(place), number);
#ifndef NO_E4
            store(RINGER, COUNTER(place), number + 1);                              /* E4 */
#endif
            fence(RINGER);
            d_step { heard = asleep[place]; asleep[place] = false };
            if
            :: heard -> unheard[place] = 0
            :: else -> unheard[place]++
            fi;
            heard = false;
#ifndef NO_E5
            if
            :: unheard[place] == UNHEARD ->     /* E5 */
                unheard[place] = 0;
#ifdef NO_LOCK
                store(RINGER, FLAG(place), 0)
#else
                if
                :: atomic { !locked[place] -> locked[place] = true }
                    store(RINGER, FLAG(place), 0);
#ifndef UNLOCK_EARLY
                    fence(RINGER);
#endif
                    locked[place] = false
                :: locked[place]
                fi
#endif
            :: else
            fi
#endif
        :: else
        fi;
        number = 0;
        place++
    :: else -> break
    od;
    place = 0;
    if
    :: data < RINGS + UNHEARD -> goto ring
    :: else
    fi;
    fence(RINGER);
    assert(!memory[FLAG(0)] && !memory[FLAG(1)])
}

#define DIE if :: skip :: place == 1 && life + 1 < LIVES -> goto killed fi

proctype waiter(byte place) {
    byte value, data, seen, life;
begin:
    atomic { !locked[place] -> locked[place] = true };
    DIE;
    store(place, FLAG(place), 0);
    load(place, DATA, seen);
    do
    :: seen == RINGS -> break
    :: else ->
        DIE;
#ifndef LOOK_FIRST
        load(place, COUNTER(place), value);     /* D0 */
        DIE;
#endif
        store(place, FLAG(place), 1);           /* D1 */
        DIE;
#ifndef NO_D2
        fence(place);                           /* D2 */
#endif
        load(place, DATA, data);                /* D3 */
#ifdef LOOK_FIRST
        load(place, COUNTER(place), value);
#endif
        if
        :: data != seen
        :: else ->
            DIE;
            fence(place);                       /* D4 */
            asleep[place] = (memory[COUNTER(place)] == value);
            if
            :: !asleep[place]
            :: place == 1 && life + 1 < LIVES -> asleep[place] = false; goto killed
            fi
        fi;
        DIE;
        store(place, FLAG(place), 0);
        load(place, DATA, seen);
        value = 0;
        data = 0
    od;
    fence(place);
    locked[place] = false;
    goto leave;
killed:
    value = 0; data = 0; seen = 0;
    life++;
    fence(place);
    locked[place] = false;
    if
    :: goto begin
    :: true
    fi;
leave:
    ended++
}

init { atomic { run waiter(0); run waiter(1) } }
