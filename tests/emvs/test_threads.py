"""Work that threads share."""

import threading

import pytest

from roller_emvs.threads import share


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_each_call_is_made_once(threads):
    made = [0] * 40

    def run(k):
        made[k] += 1

    share(threads, len(made), run)
    assert made == [1] * len(made)


def test_threads_work_at_the_same_time():
    both = threading.Barrier(2, timeout=30)  # nobody gets past it alone
    share(2, 2, lambda _: both.wait())


def test_calls_share_their_own_work():
    made = set()
    share(4, 8, lambda k: share(4, 8, lambda m: made.add((k, m))))
    assert len(made) == 64


@pytest.mark.parametrize("bad", [0, 1])
def test_an_error_comes_out_when_all_have_ended(bad):
    both, ended = threading.Barrier(2, timeout=30), []

    def run(k):
        both.wait()
        if k == bad:
            raise ValueError("bad")
        ended.append(k)

    with pytest.raises(ValueError, match="bad"):
        share(2, 2, run)
    assert ended == [1 - bad]
