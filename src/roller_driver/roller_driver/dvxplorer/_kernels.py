"""Decodes the camera's 32-bit words; arrays in, preallocated arrays out.

The state is carried from transfer to transfer in `s`, the counts in `c`; their places have names
here. The tests hold the kernel to a plain twin.
"""

from __future__ import annotations

import numba
import numpy as np

# State.
REFERENCE = 0  # ms, extended over its 22 bits; -1 while one is waited for
EXTENDED = 1  # the newest reference believed, extended
LAST_RAW = 2  # its 22 bits; -1 before the first
PENDING = 3  # a reference out of turn, believed when the next one follows it; -1 none
USED_REFERENCE = 4  # of the last frame
USED_SUB = 5
COLUMN = 6  # -1 outside frames
TIME_US = 7  # of the frame
STARTED = 8  # whether a frame was seen since the last reset
STATE_SIZE = 9

# Counts.
FRAMES = 0
LOST_REFERENCES = 1
COLUMN_JUMPS = 2
DROPPED_FRAMES = 3
DROPPED_WORDS = 4
PADDING = 5
BAD_WORDS = 6
BAD_REFERENCES = 7
TIME_STEPS = 8
COUNTS = 9

_REFERENCE_MASK = 0x3FFFFF
# A reference comes every millisecond; one that lies further ahead is a corrupt word or a restart.
_MAX_AHEAD_MS = 60_000

_LOWEST = np.array([0] + [(k & -k).bit_length() - 1 for k in range(1, 256)], dtype=np.uint8)


@numba.njit(cache=True, nogil=True)
def _take_reference(w, s, c):  # type: ignore[no-untyped-def]
    """Take a time-stamp reference word."""
    raw = np.int64(w) & _REFERENCE_MASK
    if s[LAST_RAW] < 0:
        s[EXTENDED] = raw
    else:
        ahead = (raw - s[LAST_RAW]) & _REFERENCE_MASK
        if ahead <= _MAX_AHEAD_MS:
            s[EXTENDED] += ahead
        elif s[PENDING] >= 0 and ((raw - s[PENDING]) & _REFERENCE_MASK) <= _MAX_AHEAD_MS:
            # The clock was set again: same overflows, other milliseconds.
            s[EXTENDED] += raw - s[LAST_RAW]
            c[TIME_STEPS] += 1
        else:
            s[PENDING] = raw
            s[REFERENCE] = -1
            s[COLUMN] = -1
            c[BAD_REFERENCES] += 1
            return
    s[LAST_RAW] = raw
    s[PENDING] = -1
    s[REFERENCE] = s[EXTENDED]


@numba.njit(cache=True, nogil=True)
def _take_column(w, width, s, c):  # type: ignore[no-untyped-def]
    """Take a column word: the next column of a frame, or the first of a new one."""
    column = np.int64(w) & 0x3FF
    if (w >> 21) & 1:
        s[COLUMN] = -1
        if s[REFERENCE] < 0:
            if s[STARTED]:
                c[DROPPED_FRAMES] += 1
            return
        sub = (np.int64(w) >> 11) & 0x3FF
        if s[REFERENCE] == s[USED_REFERENCE] and sub <= s[USED_SUB]:
            # Time can't stand still: a reference in between was lost, and with it this time.
            c[LOST_REFERENCES] += 1
            c[DROPPED_FRAMES] += 1
            s[REFERENCE] = -1
            return
        if column >= width:
            c[BAD_WORDS] += 1
            c[DROPPED_FRAMES] += 1
            return
        s[USED_REFERENCE] = s[REFERENCE]
        s[USED_SUB] = sub
        s[TIME_US] = s[REFERENCE] * 1000 + sub
        s[COLUMN] = column
        s[STARTED] = 1
        c[FRAMES] += 1
    elif s[COLUMN] >= 0:
        if column >= width:
            # Where its pixels belong isn't known, nor whether the next columns are of this frame.
            c[BAD_WORDS] += 1
            c[DROPPED_FRAMES] += 1
            s[COLUMN] = -1
        elif column <= s[COLUMN]:
            # The start of a new frame was lost.
            c[COLUMN_JUMPS] += 1
            c[DROPPED_FRAMES] += 1
            s[COLUMN] = -1
            s[REFERENCE] = -1
        else:
            s[COLUMN] = column


@numba.njit(cache=True, nogil=True)
def _decode_words(words, width, height, s, c, x, y, t_ns, p):  # type: ignore[no-untyped-def]
    """Decode words; returns the number of events. The outputs hold 16 events a word."""
    n = 0
    column = s[COLUMN]
    t = s[TIME_US] * 1000
    last_group = height // 8 - 1
    for i in range(len(words)):
        w = words[i]
        if w & 0x80000000:
            if column < 0:
                c[DROPPED_WORDS] += s[STARTED]
                continue
            g1 = (np.int64(w) >> 18) & 0x3F
            g2 = g1 + ((np.int64(w) >> 26) & 0x1F)
            mask = np.int64(w) & 0xFF
            mask2 = (np.int64(w) >> 8) & 0xFF
            if g1 > last_group or (g2 > last_group and mask2):
                c[BAD_WORDS] += 1
                continue
            polarity = 1 - ((np.int64(w) >> 16) & 1)
            while mask:
                x[n] = column
                y[n] = 8 * g1 + _LOWEST[mask]
                t_ns[n] = t
                p[n] = polarity
                n += 1
                mask &= mask - 1
            mask = mask2
            polarity = 1 - ((np.int64(w) >> 17) & 1)
            while mask:
                x[n] = column
                y[n] = 8 * g2 + _LOWEST[mask]
                t_ns[n] = t
                p[n] = polarity
                n += 1
                mask &= mask - 1
            continue
        kind = w >> 26
        if kind == 1:
            _take_column(w, width, s, c)
            column = s[COLUMN]
            t = s[TIME_US] * 1000
        elif kind == 2:
            _take_reference(w, s, c)
            column = s[COLUMN]
        elif w == 0:
            c[PADDING] += 1
        else:
            c[BAD_WORDS] += 1
    return n


@numba.njit(cache=True, nogil=True)
def _accumulate(x, y, p, image):  # type: ignore[no-untyped-def]
    """Add ON events to and subtract OFF events from an image, shape (height, width), int16."""
    for i in range(len(x)):
        image[y[i], x[i]] += 2 * np.int16(p[i]) - 1
