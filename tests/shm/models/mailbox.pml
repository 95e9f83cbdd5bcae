/* shm/mailbox/mailbox.py and shm/mailbox/client.py: one place; a client and an owner, each of which may be killed at every step and
 * has a successor. Client and owner may die both, and in the middle of a recovery.
 *
 * A command has two cells, a reply has its id and its body, so that torn ones show. Commands of different lives of the
 * client differ in content. A command is answered before the next one is taken, as our owners do; with ACCEPTS, one at
 * a time may stay under way, accepted, and is done when others have been taken.
 *
 * With STOPS it is the place for stops: two who stop keep no place, each has it for as long as it stores a command and
 * looks for the answer without it. Lock and unlock are full fences.
 */

#ifndef COMMANDS
#define COMMANDS 3
#endif
#ifndef CLIENTS
#define CLIENTS 2       /* lives at the client's place */
#endif
#ifndef OWNERS
#define OWNERS 2        /* lives of the owner */
#endif
#define DEPTH 2         /* of the queue, and of the reply ring */
#define ACCEPTED 1
#define REFUSED 2
#define DONE 3
#define FAILED 4
#define REPLY(id, outcome) (8 * (id) + outcome)

#define CLIENT 0
#define OWNER 1
#ifdef STOPS
#define OTHER 2
#define PROCESSES 3
#else
#define PROCESSES 2
#endif
#ifndef SIZE
#define SIZE 2
#endif
#define SENT 0
#define TAKEN 1
#define ANSWERED 2
#define FIRST(n) (3 + 2 * ((n) % DEPTH))
#define SECOND(n) (4 + 2 * ((n) % DEPTH))
#define SEQUENCE(n) (3 + 2 * DEPTH + 3 * ((n) % DEPTH))
#define ID(n) (4 + 2 * DEPTH + 3 * ((n) % DEPTH))
#define BODY(n) (5 + 2 * DEPTH + 3 * ((n) % DEPTH))
#define CELLS (3 + 5 * DEPTH)
#define ALWAYS skip

#include "tso.pml"

/* What no process knows, only the checks: */
byte issued[COMMANDS + 1];      /* the content of each command past M3 */
bool ran[COMMANDS + 1];
byte outcome[COMMANDS + 1];     /* the last answer to each command that is out */
byte accepted[COMMANDS + 1];    /* the reply that said so */
byte begun;                     /* the last reply whose slot was touched */
bool quiet;                     /* every command is taken and done, and all stores are out */
#ifdef STOPS
byte replied[COMMANDS + 1];     /* the last reply to each command */
#endif

/* A command is answered once, but for one that was accepted: once more, when it has come to its end. */
inline answers(command, how) {
    d_step {
        assert(!outcome[command] || (outcome[command] == ACCEPTED && how >= DONE));
        outcome[command] = how;
#ifdef STOPS
        replied[command] = begun;
#endif
        if
        :: how == ACCEPTED -> accepted[command] = begun
        :: else -> accepted[command] = 0
        fi
    }
}

/* What was accepted has come to its end, unless nobody can know: that reply has been overwritten. */
#define ENDED(command) (outcome[command] > ACCEPTED || (accepted[command] && begun >= accepted[command] + DEPTH))

#define KILL(life, lives) if :: skip :: life + 1 < lives -> goto killed fi
#define DIE KILL(life, CLIENTS)

/* Two stores of one copy, in any order. */
#define STORE_BOTH(me, where, what, elsewhere, other) \
    if \
    :: PUT(me, where, what); PUT(me, elsewhere, other) \
    :: PUT(me, elsewhere, other); PUT(me, where, what) \
    fi

/* A store, and perhaps death: whether it dies here is for others no step of its own. */
#define PUT(me, where, what) atomic { store(me, where, what); DIE }

#ifdef STOPS
#define CONTENT (2 * (CLIENTS * (count + 1) + life) + (me == OTHER))

#undef DIE
#define DIE if :: skip :: me == CLIENT && life + 1 < CLIENTS -> goto killed fi  /* one of them: the other lives on */

bool locked;

proctype stopper(byte me) {
    byte count, known, seen, life, mine, head, id, body, sequence;
    bool inside;
begin:
    atomic { count = 0; known = 0; head = 0; id = 0; body = 0; sequence = 0; DIE };
    if
    :: !mine && !quiet && memory[SENT] < COMMANDS -> goto stop
    :: mine && memory[ANSWERED] != seen -> goto poll
    :: quiet && (!mine || memory[ANSWERED] == seen) -> goto done
    fi;
stop:
#ifdef L2_FIRST
    load(me, SENT, count);
    load(me, TAKEN, known);
#endif
#ifndef NO_L1
    atomic { !locked -> locked = true; inside = true; DIE };                        /* L1 */
#endif
#ifndef L2_FIRST
    load(me, SENT, count);                      /* L2 */
    load(me, TAKEN, known);
#endif
#ifndef SEEN_LATE
    load(me, ANSWERED, seen);
#endif
    if
    :: count == COMMANDS || count + 1 - known > DEPTH -> goto leave     /* all were sent, or it is full */
    :: else
    fi;
#ifdef L3_FIRST
    atomic { fence(me); locked = false; inside = false };
#endif
    STORE_BOTH(me, FIRST(count + 1), CONTENT, SECOND(count + 1), CONTENT);
    atomic {
        assert(issued[count + 1] == 0);
        issued[count + 1] = CONTENT;
        store(me, SENT, count + 1);
        mine = count + 1;
        DIE
    };
#ifdef SEEN_LATE
    load(me, ANSWERED, seen);
#endif
leave:
    atomic {
        fence(me);
        locked = (inside -> false : locked);                                        /* L3 */
        inside = false;
        goto begin
    };
poll:
    atomic {
        load(me, ANSWERED, head);
        if
        :: head > seen + DEPTH -> assert(begun >= head); seen = head - DEPTH
        :: else
        fi
    };
    do
    :: seen < head ->
        seen++;
        load(me, ID(seen), id);
        load(me, BODY(seen), body);
        atomic {
            load(me, SEQUENCE(seen), sequence);
            if
            :: sequence != seen -> assert(begun >= seen + DEPTH)
            :: sequence == seen && id == mine ->
                assert(body == REPLY(id, outcome[id]) || body == REPLY(id, ACCEPTED));
                mine = (body % 8 == ACCEPTED -> mine : 0)
            :: sequence == seen && id != mine
            fi;
            id = 0; body = 0; sequence = 0
        }
    :: else -> goto begin
    od;
killed:
    atomic {
        life++; count = 0; known = 0; head = 0; id = 0; body = 0; sequence = 0; seen = 0; mine = 0
    };
    atomic { EMPTY(me) -> locked = (inside -> false : locked); inside = false; goto begin };
done:
    assert(!mine || begun >= replied[mine] + DEPTH)     /* heard, or overwritten before it could be */
}

init { atomic { run stopper(CLIENT); run stopper(OTHER) } }
#else
#define CONTENT (CLIENTS * (count + 1) + life)

active proctype client() {
    byte count, known, seen, life;
    byte head, id, body, sequence;
begin:
    count = 0; known = 0; seen = 0;
#ifdef HEIR_FORGETS
    load(CLIENT, TAKEN, count);
#else
    load(CLIENT, SENT, count);
#endif
    load(CLIENT, TAKEN, known);
    load(CLIENT, ANSWERED, seen);
idle:
    atomic { head = 0; DIE };
    if
    :: count < COMMANDS -> goto send
    :: memory[ANSWERED] != seen -> goto poll
    :: count == COMMANDS && quiet && memory[ANSWERED] == seen -> goto done
    fi;
send:
#ifndef NO_M1
    if
    :: count + 1 - known > DEPTH ->             /* M1 */
        load(CLIENT, TAKEN, known);
        if
        :: count + 1 - known > DEPTH -> goto idle
        :: else
        fi
    :: else
    fi;
#endif
#ifdef M3_FIRST
    issued[count + 1] = CONTENT;
    PUT(CLIENT, SENT, count + 1);
#endif
    STORE_BOTH(CLIENT, FIRST(count + 1), CONTENT, SECOND(count + 1), CONTENT);      /* M2 */
#ifndef M3_FIRST
    atomic {
        assert(issued[count + 1] == 0);
        issued[count + 1] = CONTENT;
        store(CLIENT, SENT, count + 1);         /* M3 */
        count++;
        goto idle
    };
#else
    count++;
    goto idle;
#endif
poll:
    atomic {
        load(CLIENT, ANSWERED, head);           /* B1 */
        if
        :: head > seen + DEPTH -> assert(begun >= head); seen = head - DEPTH
        :: else
        fi
    };
    do
    :: seen < head ->
        seen++;
        load(CLIENT, ID(seen), id);             /* B2 */
        load(CLIENT, BODY(seen), body);
        atomic {
#ifndef NO_B3
            load(CLIENT, SEQUENCE(seen), sequence);     /* B3 */
#else
            sequence = seen;
#endif
            if
            :: sequence == seen -> assert(body == REPLY(id, outcome[id]) || body == REPLY(id, ACCEPTED))
            :: else -> assert(begun >= seen + DEPTH)
            fi;
            id = 0; body = 0; sequence = 0
        }
    :: else -> goto idle
    od;
killed:
    atomic { life++; count = 0; known = 0; seen = 0; head = 0; id = 0; body = 0; sequence = 0 };
    EMPTY(CLIENT);
    goto begin;
done:
    skip
}
#endif

#undef DIE
#define DIE KILL(life, OWNERS)

active proctype owner() {
    byte taken, answered, end, life, how, number, at, to, under_way;
    byte first, second, last[COMMANDS + 1];
    bool refuse, recovers;
begin:
    end = 0; how = 0; number = 0; at = 0; to = 0;
    atomic {    /* the only one who writes these reads them: no step of others matters in between */
        load(OWNER, TAKEN, taken);
        load(OWNER, ANSWERED, answered);
#ifndef NO_V1
        load(OWNER, SEQUENCE(answered + 1), at);        /* V1 */
        if
        :: at == answered + 1 -> answered++
        :: else
        fi;
#endif
        store(OWNER, ANSWERED, answered);
        DIE
    };
#ifndef NO_V2
    atomic {
        number = (answered < DEPTH -> 0 : answered - DEPTH);                        /* V2 */
        do
        :: number < answered ->
            number++;
            load(OWNER, ID(number), to);
            load(OWNER, BODY(number), how);
#ifdef V2_HALF
            at = number;
#else
            load(OWNER, SEQUENCE(number), at);
#endif
            if
            :: at == number -> last[to] = how % 8
            :: else
            fi
        :: else -> break
        od;
        last[taken] = (last[taken] == 0 -> ACCEPTED : last[taken]);
        to = 0;
        recovers = true;
    };
recover:
    at = 0; how = FAILED;
    if
    :: to < COMMANDS ->
        to++;
        if
#ifdef V2_TAKEN
        :: last[to] == ACCEPTED && to == taken -> last[to] = 0; goto answer
#else
        :: last[to] == ACCEPTED -> last[to] = 0; goto answer
#endif
        :: else -> last[to] = 0; goto recover
        fi
    :: else -> last[0] = 0; recovers = false
    fi;
#endif
    if
    :: refuse = true                            /* V3 */
    :: refuse = false
    fi;
look:
    end = 0; number = 0; at = 0; how = 0; to = 0;
    load(OWNER, SENT, end);                     /* N1 */
    if
    :: end == taken && refuse -> refuse = false; goto look
    :: end == taken && !refuse && !under_way && taken == COMMANDS -> goto done
    :: end == taken && !refuse && !under_way && taken < COMMANDS -> memory[SENT] != taken; goto look
    :: end != taken
    :: under_way -> to = under_way; how = DONE; under_way = 0; goto answer
    fi;
take:
    to = 0; how = 0;
#ifdef N3_FIRST
    PUT(OWNER, TAKEN, taken + 1);
#endif
    load(OWNER, FIRST(taken + 1), first);       /* N2 */
    load(OWNER, SECOND(taken + 1), second);
    taken++;
#if !defined(N3_FIRST) && !defined(N4_FIRST)
    PUT(OWNER, TAKEN, taken);                   /* N3 */
#endif
    atomic {
        assert(first == second);
        assert(first == issued[taken]);
        assert(!ran[taken] && !outcome[taken]);
        first = 0; second = 0;
        to = taken;
        if
        :: refuse -> how = REFUSED
        :: !refuse -> ran[taken] = true; how = DONE                                 /* N4 */
#ifdef ACCEPTS
        :: !refuse && !under_way -> ran[taken] = true; how = ACCEPTED; under_way = taken
#endif
        fi;
        DIE
    };
answer:
    number = answered + 1;
#ifndef NO_A1
    atomic { begun = number; store(OWNER, SEQUENCE(number), 0); DIE };              /* A1 */
#else
    begun = number;
#endif
#ifdef A3_FIRST
    atomic { answers(to, how); store(OWNER, SEQUENCE(number), number); DIE };
#endif
    STORE_BOTH(OWNER, ID(number), to, BODY(number), REPLY(to, how));                /* A2 */
#ifndef A3_FIRST
    atomic { answers(to, how); store(OWNER, SEQUENCE(number), number); DIE };       /* A3 */
#endif
    answered = number;
    atomic { store(OWNER, ANSWERED, answered); number = 0; DIE };                   /* A4 */
#ifdef N4_FIRST
    PUT(OWNER, TAKEN, taken);
#endif
    if
#ifndef NO_V2
    :: recovers -> goto recover
#endif
    :: !recovers && taken < end -> goto take
    :: !recovers && taken >= end -> goto look
    fi;
killed:
    life++;
    d_step {
        taken = 0; answered = 0; under_way = 0; refuse = false; recovers = false;
        first = 0; second = 0; end = 0; how = 0; at = 0; to = 0;
        for (number : 0 .. COMMANDS) { last[number] = 0 }
        number = 0
    };
    EMPTY(OWNER);
    goto begin;
done:
    EMPTY(OWNER);
    d_step {
        for (number : 1 .. COMMANDS) { assert(ENDED(number)) }
        number = 0;
        quiet = true
    }
}
