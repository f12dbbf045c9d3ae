"""The account of a window as names and values, and in a message."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from roller_core import outputs
from roller_core.outputs import Output
from roller_core.window_account import AccountError, WindowAccount, account_of
from roller_ros.messages import to_message

COUNTS = st.integers(0, 2**62)
MS = st.integers(0, 10**7).map(lambda us: us / 1000)
WORDS = st.text(st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), max_size=30)


@given(
    st.builds(
        WindowAccount, COUNTS, COUNTS, COUNTS, COUNTS,
        st.dictionaries(WORDS, MS, max_size=5), MS, st.lists(WORDS, max_size=3).map(tuple),
    )
)  # fmt: skip
def test_a_message_gives_the_account_back(account: WindowAccount) -> None:
    """Whatever stages and reasons are called; times to a microsecond."""
    assert WindowAccount.of_pairs(account.pairs()) == account
    message = to_message(Output(outputs.DEPTH_ACCOUNT, 1_500_000_000, "camera", account))
    assert account_of(message) == account
    assert message.header.stamp.nanosec == 500_000_000
    assert message.status[0].level == (b"\x01" if account.lost else b"\x00")


def test_what_is_no_account_is_refused() -> None:
    """In one line that says what is missing or isn't a number."""
    pairs = WindowAccount(1, 2, 3, 4).pairs()
    with pytest.raises(AccountError, match="without events"):
        WindowAccount.of_pairs([p for p in pairs if p[0] != "events"])
    with pytest.raises(AccountError, match="many"):
        WindowAccount.of_pairs([*pairs, ("points", "many")])
