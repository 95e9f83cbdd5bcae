"""From the boards' reply to the write behind it in native calls: the same as step by step, whatever comes."""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from tests.native.shadow import bits as bits_of
from tests.native.socket_harness import CALM, SECOND_NS, SocketHarness
from trocar.procs.fpga import wire
from trocar.procs.io.bus.exchange import Exchange
from trocar.procs.io.bus.link import Counters
from trocar.procs.io.bus.protocols import QueryRead
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.io_fields import CONTROLLED, IO, MISSED, SENT, STATUS
from trocar.procs.native.library import bind, native
from trocar.procs.node.inputs import FOR_EVER_NS
from trocar.shm.time.clock import boottime_ns

pytestmark = pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")


@pytest.fixture
def psm() -> Iterator[SocketHarness]:
    made = SocketHarness()
    with contextlib.closing(made.port), contextlib.ExitStack() as held:
        held.callback(made.link.end)
        yield made


COUNTED = ("reads", "writes", "bad_reads", "bad_writes", "stray", "timeouts", "dropped", "sequence_errors")


def good(counters: Counters) -> bool:
    """Nothing has gone wrong."""
    return not (counters.bad_reads or counters.bad_writes or counters.timeouts or counters.stray or counters.dropped)


def test_a_calm_cycle_is_one_call(psm: SocketHarness, monkeypatch: pytest.MonkeyPatch) -> None:
    psm.port.counters.clear()
    psm.link.forget_written()
    for part, name in ((psm.exchange.link, "receive"), (psm.core, "_decide"), (psm.port, "write_all")):
        monkeypatch.setattr(part, name, None)
    psm.bits.clear()
    psm.cycle(count=20)
    assert psm.bits == [CALM] * 20
    psm.link.deliver()
    counters = psm.port.counters
    assert len(psm.link.written) == 20
    assert counters.reads == counters.writes == 20 and good(counters) and psm.errors() == []
    assert psm.record.recv_ns < psm.record.write_ns and psm.record.valid and psm.record.pid_enabled[0]


def test_the_boards_understand_what_the_call_has_sent(psm: SocketHarness) -> None:
    before = psm.record.position.copy()
    goal = before.copy()
    goal[2] += 0.01
    psm.to(goal)
    psm.link.forget_written()
    for _ in range(3000):
        psm.cycle()
        if abs(psm.record.position[2] - goal[2]) < 2e-3:
            break
    assert abs(psm.record.position[2] - goal[2]) < 2e-3 and psm.link.written and psm.errors() == []


def test_the_calls_leave_what_step_by_step_leaves(psm: SocketHarness, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the bit: every array of io's halves, of what came and of what was sent."""
    halves = bind(IO, psm.core.parts)
    assert isinstance(halves, BoundStruct)
    exchange, reader, groups = psm.exchange, psm.exchange._reader, psm.exchange._writer.groups
    receive, send = exchange._receive, exchange._send
    assert receive is not None and send is not None
    arrays = [array for array in halves.arrays.values() if array.flags.writeable]
    arrays += [reader.blocks.masked, reader.blocks.bad, reader.blocks.last, groups.datagram_array]
    compared: list[int] = []

    def both(by_call: Callable[[], int], step_by_step: Callable[[], int]) -> int:
        before = [array.copy() for array in arrays]
        bits = by_call()
        after = [array.copy() for array in arrays]
        for array, was in zip(arrays, before, strict=True):
            array[...] = was
        assert step_by_step() == bits
        for made, array in zip(after, arrays, strict=True):
            assert np.array_equal(bits_of(made), bits_of(array))
        compared.append(bits)
        return bits

    def write(label: int, share: float, has_sample: int) -> int:
        bits = psm.core.halves.control_and_encode(share, has_sample)
        groups.pack()
        groups.datagram[:22] = exchange._writer.heads()[label]
        groups.sent()
        return bits | SENT

    def step_by_step(fd, tl, label, timeout_ms, spin_ns, good_ns, wake_ns, over_ns, gap_ns) -> int:
        assert reader.take(int(exchange.came[0]))
        bits = psm.core.halves.decode_and_check()
        if bits or exchange.came[1] >= wake_ns:
            return bits
        settings = exchange.settings
        gap_ns += (min(int(exchange.came[1]) - good_ns, settings.oldest_ns) - gap_ns) / settings.gaps
        return write(label, min(1.0, settings.stable_ns / gap_ns), 1)

    monkeypatch.setattr(exchange, "_receive", lambda *given: both(
        lambda: receive(*given), lambda: step_by_step(*given)))
    monkeypatch.setattr(exchange, "_send", lambda fd, label, share, has_sample, over_ns: both(
        lambda: send(fd, label, share, has_sample, over_ns), lambda: write(label, share, has_sample)))
    goal = psm.record.position.copy()
    for cycle in range(100):
        goal[0] += 1e-4
        psm.to(goal)
        psm.core._good_ns -= cycle % 4 * SECOND_NS  # some gaps are longer: then efforts are less
        psm.core.power.wake_ns = FOR_EVER_NS if cycle % 7 else 0  # sometimes Python has its turn between the halves
        psm.cycle()
    assert compared.count(CALM) > 90 and compared.count(0) > 5 and psm.errors() == []


def stray(reply: bytes) -> bytes:
    """The reply to another read."""
    return reply[:2] + bytes((reply[2] ^ 0x80,)) + reply[3:]


@pytest.mark.parametrize("before", [
    stray, lambda reply: b"", lambda reply: b"\1", lambda reply: stray(reply) + bytes(4096 - len(reply)),
], ids=["label", "empty", "byte", "large"])
def test_what_comes_before_the_reply_is_thrown_away(psm: SocketHarness, before: Callable[[bytes], bytes]) -> None:
    psm.port.counters.clear()
    psm.link.spoil = lambda reply: [before(reply), reply]
    assert psm.once() == [0, CALM]
    assert psm.port.counters.stray == 1 and psm.port.counters.bad_reads == 0 and psm.record.valid
    psm.link.spoil = lambda reply: [reply]
    assert psm.once() == [CALM] and psm.errors() == []


@pytest.mark.parametrize("bad", [
    lambda reply: reply[:-4], lambda reply: reply + bytes(4), lambda reply: bytes(len(reply)),
    lambda reply: reply[:5] + bytes((reply[5] ^ 1,)) + reply[6:], lambda reply: reply[:3] + b"\0" + reply[4:],
    lambda reply: reply[:13] + bytes((reply[13] ^ 4,)) + reply[14:],
    lambda reply: reply[:20] + bytes((reply[20] ^ 0xFF,)) + reply[21:],
    lambda reply: reply[:28] + bytes((reply[28] ^ 0xFF,)) + reply[29:],
], ids=["short", "long", "zeros", "other node", "no block", "other length", "other query", "other board"])
def test_what_is_not_the_wanted_sample_is_no_sample(psm: SocketHarness, bad: Callable[[bytes], bytes]) -> None:
    psm.port.counters.clear()
    blocks, bad_reads = psm.port.blocks.copy(), int(psm.record.bad_reads)
    psm.link.spoil = lambda reply: [bad(reply)]
    assert psm.once() == [MISSED, SENT]
    counters = psm.port.counters
    assert counters.bad_reads == 1 and counters.writes == 1 and counters.board_bad_reads.any()
    assert np.array_equal(psm.port.blocks, blocks) and psm.record.bad_reads == bad_reads + 1 and not psm.record.valid
    psm.link.spoil = lambda reply: [reply]
    psm.calm()
    assert psm.errors() == []


def test_silence_is_waited_for_once(psm: SocketHarness) -> None:
    psm.port.counters.clear()
    psm.link.spoil = lambda reply: []
    assert psm.once() == [MISSED, SENT]
    counters = psm.port.counters
    assert counters.timeouts == 1 and counters.bad_reads == 1
    assert counters.waited_ns == psm.exchange.link.cycle_timeout_ms * 1_000_000
    psm.link.spoil = lambda reply: [reply]
    psm.calm()
    assert psm.errors() == []


def test_a_hub_that_drops_a_read_is_no_boards_fault(psm: SocketHarness) -> None:
    psm.port.counters.clear()
    dropped = bytes((0, psm.exchange.link.generation, *bytes(6)))
    assert len(dropped) == wire.TRAILER_BYTES
    psm.link.spoil = lambda reply: [dropped]
    assert psm.once() == [MISSED, SENT]
    assert psm.port.counters.dropped == 1 and not psm.port.counters.board_bad_reads.any()
    psm.link.spoil = lambda reply: [reply]
    psm.calm()


def test_the_label_of_a_read_rests_whose_reply_may_still_come(psm: SocketHarness) -> None:
    """Where requests cannot be forgotten labels are all there is to tell replies by."""
    labels: list[int] = []

    def of_another_node(reply: bytes) -> list[bytes]:
        labels.append(reply[2] >> 2)
        return [reply[:5] + bytes((reply[5] ^ 1,)) + reply[6:]]

    psm.link.forgets, psm.link.spoil = False, of_another_node
    assert psm.once() == [MISSED, SENT]
    link = psm.exchange.link
    assert list(link._missing) == labels


def test_while_labels_rest_more_than_the_label_is_looked_at(psm: SocketHarness) -> None:
    psm.exchange.link._missing.append(5)
    psm.exchange.link._forgets = False
    assert psm.once() == [0, CALM] and psm.record.valid


def test_a_sample_with_news_is_not_answered_before_that_is_looked_at(psm: SocketHarness) -> None:
    psm.faults.lose_supply("PSM1", True)
    for _ in range(50):
        bits = psm.once()
        if not psm.record.powered[0]:
            break
    assert bits[0] & STATUS and not psm.record.powered[0]


def test_nothing_is_sent_in_a_cycle_that_was_held_up(psm: SocketHarness) -> None:
    psm.link.forget_written()
    psm.over_ns = boottime_ns() - 1
    assert psm.once() == [CONTROLLED, 0]
    psm.link.deliver()
    assert psm.link.written == [], "only what switches everything off, and not by the call"
    psm.over_ns = 1 << 62
    psm.cycle(count=3)
    assert not psm.record.amp_enabled.any() and not psm.record.powered.any()


def test_a_sample_that_power_waits_for_is_looked_at_first(psm: SocketHarness) -> None:
    looked = []
    psm.core.power.wake_ns = 1
    psm.core.power.step = lambda now_ns: looked.append(psm.bits.copy())  # type: ignore[method-assign]
    assert psm.once() == [0, CALM] and looked == [[0]], "before the words were sent"


def test_what_the_system_did_not_take_is_sent_again(psm: SocketHarness) -> None:
    psm.port.counters.clear()

    def full(reply: bytes) -> list[bytes]:
        psm.link.fill()
        return [reply]

    psm.link.spoil = full
    assert psm.once() == [CONTROLLED, 0]
    psm.link.spoil = lambda reply: [reply]
    assert psm.port.counters.writes == 1 and psm.port.counters.bad_writes == 0
    assert psm.exchange.link.suspect, "earlier datagrams may have been lost"
    psm.calm()


def state_of(psm: SocketHarness) -> dict[str, object]:
    """What the bus remembers, but for times."""
    link, reader = psm.port._link, psm.port._reader
    assert isinstance(reader, QueryRead)
    return {"link": [getattr(link, name) for name in ("tl", "sequence", "suspect", "generation", "seen_generation")],
            "missing": list(link._missing), "reader": (reader._read, reader._is_good, reader._asked, reader._sent),
            "counters": [getattr(link.counters, name) for name in COUNTED]}


@pytest.mark.parametrize("spoil", [
    lambda reply: [reply], lambda reply: [stray(reply), reply], lambda reply: [reply[:-4]], lambda reply: [],
    lambda reply: [reply[:-7] + bytes((reply[-7] ^ 1,)) + reply[-6:]],
], ids=["the reply", "another first", "short", "nothing", "start another bus generation"])
def test_the_bus_remembers_what_it_does_step_by_step(
    psm: SocketHarness, spoil: Callable[[bytes], list[bytes]],
) -> None:
    link, found = psm.port._link, []
    for exchange in (psm.exchange, None):
        psm.port.exchange = exchange
        psm.link.spoil = lambda reply: [reply]
        psm.cycle(count=100)
        link.tl, link.sequence = 3, 7
        link.counters.clear()
        psm.link.spoil = spoil
        psm.cycle()
        found.append(state_of(psm))
    assert found[0] == found[1]


def test_the_boards_time_is_learned_from_what_the_call_took(psm: SocketHarness) -> None:
    reader = psm.exchange._reader
    reader._wait_ns = 0
    psm.cycle(count=2)
    assert reader._wait_ns >= reader._least_wait_ns and psm.once() == [CALM]


def test_a_reply_is_also_found_by_looking_for_it_again_and_again(psm: SocketHarness) -> None:
    psm.exchange.link.spin_ns = 100_000
    assert psm.once() == [CALM]
    psm.link.spoil = lambda reply: []
    assert psm.once() == [MISSED, SENT] and psm.port.counters.timeouts == 1


def test_another_socket_is_taken_at_once(psm: SocketHarness) -> None:
    before = psm.link.fd
    psm.exchange.link.suspect = True
    assert psm.once() == [CALM] and psm.link.fd != before
    psm.link.forget_written()
    assert psm.once() == [CALM]
    psm.link.deliver()
    assert len(psm.link.written) == 1 and psm.errors() == []


def test_what_is_bound_anew_leaves_no_classes_behind(psm: SocketHarness) -> None:
    psm.exchange._prepare()
    before = len(ctypes.Structure.__subclasses__())
    for _ in range(5):
        psm.exchange._prepare()
    assert len(ctypes.Structure.__subclasses__()) == before and psm.once() == [CALM]


def test_after_a_bus_reset_the_call_goes_on(psm: SocketHarness) -> None:
    made_for = psm.exchange._made_for
    psm.faults.reset_bus()
    psm.cycle()
    psm.calm()
    assert psm.exchange._made_for != made_for and psm.record.valid and psm.errors() == []


def test_without_the_calls_a_sample_is_just_read(psm: SocketHarness) -> None:
    psm.port.exchange = None
    assert psm.once() == [0, CONTROLLED] and psm.record.valid and psm.port.counters.writes


def test_the_struct_is_bound_to_arrays_that_stay(psm: SocketHarness) -> None:
    exchange: Exchange = psm.exchange
    assert all(not part.moved() for part in exchange._parts)
    assert exchange.heads.shape == (wire.TL_COUNT, 22)
