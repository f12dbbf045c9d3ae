"""State machines of the two run-length encodings, in both directions.

Words are little-endian u16 with the code in bits 15:12. Layouts: facts of the formats as the
libcaer and Metavision ROS drivers publish them (EVT 3.0 by Prophesee).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from roller_core import numba_start  # noqa: F401 (before a kernel runs)

# State of an EVT 3.0 decoder between packets.
EVT3_TIME_HIGH, EVT3_TIME_LOW, EVT3_WRAPS, EVT3_Y, EVT3_BASE_X, EVT3_BASE_P, EVT3_VALID = range(7)
EVT3_STATE_SIZE = 7
# Sensors step TIME_HIGH back a little without a wrap; more than this is a wrap.
EVT3_JITTER = 10
#: Rows of a vector of libcaer_cmp.
VECTOR = 8


def _set_bits() -> np.ndarray:
    """Which bits of each byte are set, lowest first, and how many: uint16, shape (256, 9)."""
    out = np.zeros((256, VECTOR + 1), np.uint16)
    for byte in range(256):
        bits = [bit for bit in range(VECTOR) if byte >> bit & 1]
        out[byte, : len(bits)] = bits
        out[byte, VECTOR] = len(bits)
    return out


SET_BITS = _set_bits()


@njit(cache=True, nogil=True)
def _bits(mask):  # type: ignore[no-untyped-def]
    """How many of 16 bits are set."""
    mask -= (mask >> 1) & 0x5555
    mask = (mask & 0x3333) + ((mask >> 2) & 0x3333)
    mask = (mask + (mask >> 4)) & 0x0F0F
    return (mask + (mask >> 8)) & 0x1F


@njit(cache=True, nogil=True)
def _count_libcaer_cmp(words):  # type: ignore[no-untyped-def]
    n = np.int64(0)
    for i in range(len(words)):
        w = np.int32(words[i])
        code = w >> 12
        n += np.int64(code == 3) + np.int64(code == 5) * np.int64(_bits(w & 0xFF))
    return n


@njit(cache=True, nogil=True)
def _decode_libcaer_cmp(words, time_base_ns, width, height, set_bits, x, y, t, p):  # type: ignore[no-untyped-def]
    """Events inside the image; how many, and whether they are in order of time.

    Fields have room for `VECTOR` more than there are events. `set_bits` is `SET_BITS`.

    Whether a column or an event comes next can't be foretold, and a branch that goes wrong costs
    more than a word: each is taken as both, and what is written without an event is written over.
    So are the fields of a vector, all of its bits at once.
    """
    n = np.uint64(0)
    high = np.int64(0)
    low = np.int64(0)
    now = np.int64(time_base_ns)
    column = np.int64(0)
    base_y = np.int64(0)
    polarity = np.uint8(0)
    ordered = True
    for i in range(len(words)):
        w = np.int64(words[i])
        code = w >> 12
        value = w & 0xFFF
        row = w & 0x7FF
        if code >> 1 == 1:
            column = row if code == 2 else column
            x[n] = column
            y[n] = row
            p[n] = value >> 11
            t[n] = now
            n += np.uint64((code == 3) & (column < width) & (row < height))
        elif code == 5:
            left = min(max(height - base_y, 0), VECTOR)
            mask = np.uint64(w & ((1 << left) - 1) if column < width else 0)
            for bit in range(np.uint64(VECTOR)):
                x[n + bit] = column
            for bit in range(np.uint64(VECTOR)):
                y[n + bit] = np.uint16(base_y) + set_bits[mask, bit]
            for bit in range(np.uint64(VECTOR)):
                p[n + bit] = polarity
            for bit in range(np.uint64(VECTOR)):
                t[n + bit] = now
            n += np.uint64(set_bits[mask, VECTOR])
            base_y += VECTOR
        elif code == 4:
            base_y = row
            polarity = np.uint8(value >> 11)
        elif code < 2:
            high = value if code == 0 else high
            low = value if code == 1 else low
            before = now
            now = time_base_ns + ((high << 12) | low) * 1000
            ordered &= (now >= before) | (n == 0)
    return n, ordered


@njit(cache=True, nogil=True)
def _encode_libcaer_cmp(x, y, t_us, p, words):  # type: ignore[no-untyped-def]
    n = len(x)
    k = 0
    high = np.int64(0)
    low = np.int64(0)
    column = np.int64(-1)
    i = 0
    while i < n:
        new_high = t_us[i] >> 12
        new_low = t_us[i] & 0xFFF
        if new_high != high:
            high = new_high
            words[k] = high
            k += 1
        if new_low != low:
            low = new_low
            words[k] = (1 << 12) | low
            k += 1
        if np.int64(x[i]) != column:
            column = np.int64(x[i])
            words[k] = (2 << 12) | column
            k += 1
        # A run: same time, column and polarity, rows rising by less than eight.
        end = i + 1
        while (
            end < n
            and t_us[end] == t_us[i]
            and x[end] == x[i]
            and p[end] == p[i]
            and y[end] > y[end - 1]
            and y[end] - y[end - 1] < 8
        ):
            end += 1
        if end - i < 3:
            # One word an event is never longer than a vector of one or two.
            for j in range(i, end):
                words[k] = (3 << 12) | (np.int64(p[j]) << 11) | np.int64(y[j])
                k += 1
        else:
            base = np.int64(y[i])
            words[k] = (4 << 12) | (np.int64(p[i]) << 11) | base
            k += 1
            mask = 0
            for j in range(i, end):
                while np.int64(y[j]) - base >= 8:
                    words[k] = (5 << 12) | mask
                    k += 1
                    mask = 0
                    base += 8
                mask |= 1 << (np.int64(y[j]) - base)
            words[k] = (5 << 12) | mask
            k += 1
        i = end
    return k


@njit(cache=True, nogil=True)
def _count_evt3(words):  # type: ignore[no-untyped-def]
    n = 0
    triggers = 0
    for w in words:
        code = w >> 12
        if code == 2:
            n += 1
        elif code == 4 or code == 5:
            n += _bits(np.int64(w) & (0xFFF if code == 4 else 0xFF))
        elif code == 10:
            triggers += 1
    return n, triggers


@njit(cache=True, nogil=True)
def _decode_evt3(words, state, x, y, t, p, trigger_id, trigger_t, trigger_edge):  # type: ignore[no-untyped-def]
    n = 0
    m = 0
    now = ((state[EVT3_WRAPS] << 24) | (state[EVT3_TIME_HIGH] << 12) | state[EVT3_TIME_LOW]) * 1000
    for w in words:
        code = w >> 12
        if code == 8:
            high = np.int64(w & 0xFFF)
            if state[EVT3_TIME_HIGH] - high > EVT3_JITTER:
                state[EVT3_WRAPS] += 1
            state[EVT3_TIME_HIGH] = high
            if state[EVT3_VALID] == 0:
                state[EVT3_VALID] = 1
        elif code == 6:
            state[EVT3_TIME_LOW] = w & 0xFFF
            if state[EVT3_VALID] == 1:
                state[EVT3_VALID] = 2
        elif code == 0:
            state[EVT3_Y] = w & 0x7FF
            continue
        elif code == 3:
            state[EVT3_BASE_X] = w & 0x7FF
            state[EVT3_BASE_P] = (w >> 11) & 1
            continue
        elif state[EVT3_VALID] < 2:
            # Before the first TIME_HIGH and TIME_LOW no time is known, so nothing can be placed.
            continue
        elif code == 2:
            x[n] = w & 0x7FF
            y[n] = state[EVT3_Y]
            p[n] = (w >> 11) & 1
            t[n] = now
            n += 1
            continue
        elif code == 4 or code == 5:
            width = 12 if code == 4 else 8
            for bit in range(width):
                if (w >> bit) & 1:
                    x[n] = state[EVT3_BASE_X] + bit
                    y[n] = state[EVT3_Y]
                    p[n] = state[EVT3_BASE_P]
                    t[n] = now
                    n += 1
            state[EVT3_BASE_X] += width
            continue
        elif code == 10:
            trigger_id[m] = (w >> 8) & 0xF
            trigger_edge[m] = w & 1
            trigger_t[m] = now
            m += 1
            continue
        else:
            continue
        now = (
            (state[EVT3_WRAPS] << 24) | (state[EVT3_TIME_HIGH] << 12) | state[EVT3_TIME_LOW]
        ) * 1000
    return n, m


@njit(cache=True, nogil=True)
def _encode_evt3(x, y, t_us, p, words):  # type: ignore[no-untyped-def]
    k = 0
    high = np.int64(-1)
    low = np.int64(-1)
    row = np.int64(-1)
    for i in range(len(x)):
        new_high = (t_us[i] >> 12) & 0xFFF
        new_low = t_us[i] & 0xFFF
        if new_high != high:
            high = new_high
            low = np.int64(-1)
            words[k] = (8 << 12) | high
            k += 1
        if new_low != low:
            low = new_low
            words[k] = (6 << 12) | low
            k += 1
        if np.int64(y[i]) != row:
            row = np.int64(y[i])
            words[k] = row
            k += 1
        words[k] = (2 << 12) | (np.int64(p[i]) << 11) | np.int64(x[i])
        k += 1
    return k


@njit(cache=True, nogil=True)
def _keep_inside(x, y, t, p, width, height):  # type: ignore[no-untyped-def]
    """Move events inside the image to the front; their number."""
    n = 0
    for i in range(len(x)):
        if x[i] < width and y[i] < height:
            if n != i:
                x[n] = x[i]
                y[n] = y[i]
                t[n] = t[i]
                p[n] = p[i]
            n += 1
    return n
