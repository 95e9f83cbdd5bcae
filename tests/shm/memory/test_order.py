"""Memory order: plain words where the processor keeps our order, fences elsewhere, and a refusal without them."""

from __future__ import annotations

import platform

import pytest

from trocar.shm.memory import order


@pytest.fixture
def words() -> memoryview:
    return memoryview(bytearray(64)).cast("Q")


def test_x86_64_words_are_used_as_they_are(words: memoryview, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    monkeypatch.delenv("TROCAR_FENCES", raising=False)
    assert order.ordered(words) is words


def test_copies_that_may_overtake_stores_are_fenced_everywhere(
    words: memoryview, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    assert order.ordered(words, order.PLAIN_COPY) is words
    assert isinstance(order.ordered(words, order.PLAIN_COPY + 1), order.FencedWords)


@pytest.mark.parametrize("machine", ["aarch64", "riscv64", "ppc64le", ""])
def test_other_processors_get_words_between_fences(
    words: memoryview, monkeypatch: pytest.MonkeyPatch, machine: str
) -> None:
    monkeypatch.setattr(platform, "machine", lambda: machine)
    assert isinstance(order.ordered(words), order.FencedWords)


def test_each_access_stands_between_two_fences(words: memoryview) -> None:
    seen: list[int] = []
    fenced = order.FencedWords(words, lambda: seen.append(words[3]))
    fenced[3] = 7
    assert seen == [0, 7]
    assert fenced[3] == 7 and seen == [0, 7, 7, 7]


def test_the_library_has_a_fence_that_can_be_called() -> None:
    order.library_fence()()


def test_without_libatomic_nothing_is_attached_elsewhere(
    words: memoryview, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    monkeypatch.setattr(order, "LIBRARIES", ("libnowhere.so.1",))
    for attempt in (lambda: order.ordered(words), order.full_fence):
        with pytest.raises(order.OrderError, match=r"aarch64 does not keep.*apt-get install libatomic1"):
            attempt()


def test_a_full_fence_can_be_had_on_both_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    for asked in ("0", "1"):
        monkeypatch.setenv("TROCAR_FENCES", asked)
        assert order.fences_wanted() == (asked == "1" or platform.machine() not in order.ORDERED)
        order.full_fence()()
