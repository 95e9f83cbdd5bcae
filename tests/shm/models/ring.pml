/* shm/ring/ring.py: a writer that may be killed at every step, its successors, and two readers: one of the newest record,
 * one in order (MIXED: it asks for the newest as well, now and then).
 *
 * A slot has its sequence and two cells of payload, so that a torn record shows. Records of different lives of the
 * writer differ in content. RETRIES is 1 or 2 instead of 16. Readers store nothing, so they cannot disturb each other:
 * what holds for one holds for many, and one alone allows for more records and deaths.
 */

#ifndef DEPTH
#define DEPTH 2         /* one slot kept, one busy: every record laps the one before the last */
#endif
#ifndef RECORDS
#define RECORDS 3
#endif
#ifndef LIVES
#define LIVES 2         /* of the writer */
#endif
#ifndef FROM            /* which readers take part, FROM .. TO: 0 the one of the newest, 1 the one in order */
#define FROM 0
#endif
#ifndef TO
#define TO 1
#endif
#ifndef RETRIES
#define RETRIES 1
#endif
#define BUSY 100

#define WRITER 0
#define PROCESSES 1
#ifndef SIZE
#define SIZE 2
#endif
#define HEAD 0
#define SEQUENCE(n) (1 + 3 * ((n) % DEPTH))
#define FIRST(n) (2 + 3 * ((n) % DEPTH))
#define SECOND(n) (3 + 3 * ((n) % DEPTH))
#define CELLS (1 + 3 * DEPTH)
#define NEWEST memory[HEAD]
#define ALWAYS \
    assert(NEWEST == 0 || (memory[SEQUENCE(NEWEST)] == NEWEST \
           && memory[FIRST(NEWEST)] == memory[SECOND(NEWEST)] && memory[FIRST(NEWEST)] / LIVES == NEWEST))

#include "tso.pml"

/* What no process knows, only the checks: */
byte headed;                /* the last head that was stored */
byte issued[RECORDS + 1];   /* the content that went out under each number */
bool quiet;                 /* all is written */

#define ISSUE assert(!issued[n]); issued[n] = CONTENT
#define CONTENT (LIVES * n + life)
#define DIE if :: skip :: life + 1 < LIVES -> goto killed fi

/* A store, and perhaps death: whether it dies here is for others no step of its own. */
#define PUT(where, what) atomic { store(WRITER, where, what); DIE }

/* One memcpy: its stores may pass each other; the two cells being alike, one order of the loads covers both. */
inline put(n, content) {
    if
    :: PUT(FIRST(n), content); PUT(SECOND(n), content)
    :: PUT(SECOND(n), content); PUT(FIRST(n), content)
    fi
}

inline copy(n) {
    first = memory[FIRST(n)];
    second = memory[SECOND(n)]
}

active proctype writer() {
    byte n, life;
begin:
#ifndef NO_V1
    atomic {    /* the only one who writes these reads them: no step of others matters in between */
        n = memory[HEAD];
        if
        :: memory[SEQUENCE(n + 1)] == n + 1 ->  /* V1 */
            n++;
            headed = n;
            store(WRITER, HEAD, n);
            DIE
        :: else
        fi
    };
#else
    n = memory[HEAD];
#endif
    n++;                                        /* V2 */
    do
    ::
#ifndef NO_W1
        PUT(SEQUENCE(n), BUSY + n);             /* W1 */
#endif
        if
        :: n > RECORDS -> break
        :: else
        fi;
#ifdef W4_FIRST
        PUT(HEAD, n);
#endif
#ifdef W3_FIRST
        atomic { ISSUE; store(WRITER, SEQUENCE(n), n); DIE };
#endif
        put(n, CONTENT);                        /* W2 */
#ifndef W3_FIRST
        atomic { ISSUE; store(WRITER, SEQUENCE(n), n); DIE };   /* W3 */
#endif
#ifndef W4_FIRST
        atomic { headed = n; store(WRITER, HEAD, n); DIE };     /* W4 */
#else
        headed = n;
#endif
        n++
    od;
    EMPTY(WRITER) -> quiet = true;
    goto done;
killed:
    life++;
#ifndef NO_DRAIN
    EMPTY(WRITER);
#endif
    goto begin;
done:
    skip
}

/* What a reader takes for record n must be whole, of this number, and the only one ever given it. */
inline accept() {
    d_step {
        assert(first == second);
        assert(first == issued[n]);
        sequence = n;
        first = 0;
        second = 0
    }
}

/* Where a reader that was overrun goes on: at the oldest record kept, at later attempts ROOM records nearer to head. */
#define OLDEST (seen - DEPTH + 2)
#ifdef SKIP_FAR
#define ROOM ((1 << tries) < DEPTH - 1 -> (1 << tries) : DEPTH - 2)
#else
#define ROOM ((1 << tries) - 1 < DEPTH - 2 -> (1 << tries) - 1 : DEPTH - 2)
#endif

/* Numbers due to k - 1 are lost: at first only what no longer belongs to the DEPTH - 1 records kept. */
inline skip_to(k) {
    d_step {
        assert(headed >= k);
        assert(tries || headed >= k - 1 + DEPTH - 1);
        counted = counted + k - due;
        due = k
    }
}

#define AGAIN(label) \
    first = 0; second = 0; tries++; \
    if \
    :: tries <= RETRIES -> goto label \
    :: else -> goto failed \
    fi

proctype reader(bool in_order) {
    byte n, seen, sequence, tries, first, second;   /* `newest` */
    byte due, counted;                              /* `next`: the next number; all before us, received and lost */
    bool last;
    due = memory[HEAD] + 1;     /* attached at any time */
    counted = due - 1;
idle:
    atomic {
        n = 0; seen = 0; tries = 0; first = 0; second = 0;
        last = quiet;
        if
        :: in_order -> goto next
#ifdef MIXED
        :: true
#else
        :: else
#endif
        fi
    };
newest:
    atomic {
        n = memory[HEAD];                       /* R1 */
        if
        :: n < sequence -> assert(n == sequence - 1); n = sequence
        :: else
        fi;
        if
        :: n == 0 -> assert(!last); goto idle
        :: else
        fi
    };
    copy(n);                                    /* R2 */
    atomic {
        if
#ifndef NO_R3
        :: memory[SEQUENCE(n)] != n -> AGAIN(newest)
        :: else ->                              /* R3 */
#else
        :: true ->
#endif
            assert(n >= sequence);
            accept();
            assert(!last || n == RECORDS);
            if
            :: last && !in_order -> goto done
            :: else -> goto idle
            fi
        fi
    };
next:
    atomic {
        n = due;
        seen = memory[SEQUENCE(n)];             /* S1 */
        if
        :: seen == n -> seen = 0; goto take
        :: seen == BUSY + n -> seen = 0; goto nothing
        :: else -> seen = 0
        fi
    };
look:
    n = due;
    seen = memory[HEAD];
    if
    :: n > seen ->
        atomic {
            if
            :: memory[SEQUENCE(n)] != n -> assert(n <= seen + 2); goto nothing
            :: else
            fi
        }
    :: else
    fi;
    if
    :: n >= OLDEST ->
        copy(n);
        atomic {
            if
#ifndef NO_R3
            :: memory[SEQUENCE(n)] != n
            :: else -> goto got
#else
            :: true -> goto got
#endif
            fi
        }
    :: else
    fi;
    atomic {
        n = (n < OLDEST + ROOM -> OLDEST + ROOM : n + 1);
        skip_to(n);
        AGAIN(look)
    };
take:
    copy(n);
    atomic {
        if
#ifndef NO_R3
        :: memory[SEQUENCE(n)] != n -> first = 0; second = 0; goto look
        :: else
#else
        :: true
#endif
        fi;
        goto got
    };
got:
    atomic {
        accept();
        assert(n == due);
        due++;
        counted++;
        goto idle
    };
nothing:
    if
    :: last -> assert(counted == RECORDS && due == RECORDS + 1); goto done
    :: else -> goto idle
    fi;
failed:
    assert(!last);
    goto idle;
done:
    skip
}

init {
    atomic {
        byte i;
        for (i : FROM .. TO) { run reader(i) }
    }
}
