"""From events to the DVXplorer Mini's 32-bit words, and a plain decoder that reads them back."""

import numpy as np
import numpy.typing as npt

from roller_core.events import EventArray

Words = npt.NDArray[np.uint32]
REFERENCE = np.uint32(2 << 26)
COLUMN = np.uint32(1 << 26)
GROUP = np.uint32(1 << 31)
START = np.uint32(1 << 21)


def encode_words(events: EventArray, pairs: bool = True, padding: int = 0) -> Words:
    """Words of events in order of time; events of one microsecond make up one read-out frame.

    A reference stands before the first frame of each millisecond. An event that is there twice
    in a frame is written once.

    Parameters
    ----------
    events : EventArray
        Sensor time; whole microseconds are kept.
    pairs : bool
        Whether two groups of rows share a word where they can.
    padding : int
        Zero words after each frame.
    """
    if not len(events):
        return np.empty(0, np.uint32)
    t_us = events.t_ns // 1000
    x, y = events.x.astype(np.int64), events.y.astype(np.int64)
    off = 1 - events.p.astype(np.int64)
    # One half word a frame, column, group of rows and polarity.
    order = np.lexsort((off, y // 8, x, t_us))
    t_us, x, y, off = t_us[order], x[order], y[order], off[order]
    group = y // 8
    keys = np.stack([t_us, x, group, off])
    first = _changes(keys)
    masks = np.bitwise_or.reduceat(np.int64(1) << (y % 8), first)
    t_us, x, group, off = t_us[first], x[first], group[first], off[first]
    new_column = _flags(np.stack([t_us, x]))
    new_frame = _flags(t_us[None])
    new_reference = _flags((t_us // 1000)[None])
    # A group alone has its polarity in both places, as in the vendors' example.
    words = GROUP | (group << 18 | off << 17 | off << 16 | masks).astype(np.uint32)
    keep = np.ones(len(words), bool)
    if pairs:
        # The second of two neighbours in a column goes into the first one's upper half. Both
        # polarities of one group must share a word: the vendor's library takes a group that comes
        # again for the sign of a loss.
        twice = np.append(~new_column[1:] & (group[1:] == group[:-1]), False)
        new_block = new_column | twice | np.append([False, False], twice[:-2])[: len(twice)]
        i = np.arange(len(words))
        place = i - np.maximum.accumulate(np.where(new_block, i, 0))
        step = np.diff(group, append=group[-1:])
        a = np.flatnonzero((place % 2 == 0) & ~np.append(new_block[1:], True) & (step < 32))
        b = a + 1
        words[a] &= ~np.uint32(1 << 17)
        words[a] |= (
            step[a].astype(np.uint32) << np.uint32(26)
            | off[b].astype(np.uint32) << np.uint32(17)
            | masks[b].astype(np.uint32) << np.uint32(8)
        )
        keep[b] = False
    columns = (
        COLUMN
        | x.astype(np.uint32)
        | (t_us % 1000).astype(np.uint32) << np.uint32(11)
        | np.where(new_frame, START, np.uint32(0))
    ).astype(np.uint32)
    references = REFERENCE | ((t_us // 1000) & 0x3FFFFF).astype(np.uint32)
    # Sort everything into place: before the n-th half word stand padding, reference, column.
    i = np.arange(len(words))
    parts = [
        (4 * i[new_reference] + 1, references[new_reference]),
        (4 * i[new_column] + 2, columns[new_column]),
        (4 * i[keep] + 3, words[keep]),
    ]
    if padding:
        at = np.repeat(4 * i[new_frame], padding)
        parts.append((at, np.zeros(len(at), np.uint32)))
    place = np.concatenate([part[0] for part in parts])
    return np.concatenate([part[1] for part in parts])[np.argsort(place, kind="stable")]


def in_order(events: EventArray) -> EventArray:
    """The same events by time, column, row and polarity."""
    return events[np.lexsort((events.p, events.y, events.x, events.t_ns))]


def is_reference(words: Words) -> npt.NDArray[np.bool_]:
    """Which words are time-stamp references."""
    return (words >> np.uint32(26)) == 2


def decode_plainly(words: Words, width: int = 640, height: int = 480) -> list[tuple[int, ...]]:
    """Events (t_us, x, y, p) of words, written from the format's description, word by word."""
    out: list[tuple[int, ...]] = []
    reference = last = newest = pending = None
    used = (-1, -1)
    column, t = None, 0
    for w in map(int, words):
        if w >> 31:
            g1 = w >> 18 & 63
            halves = [(g1, w & 255, w >> 16 & 1), (g1 + (w >> 26 & 31), w >> 8 & 255, w >> 17 & 1)]
            fits = all(8 * g < height or not mask for g, mask, _ in halves) and 8 * g1 < height
            if column is not None and fits:
                for g, mask, off in halves:
                    out += [(t, column, 8 * g + b, 1 - off) for b in range(8) if mask >> b & 1]
        elif w >> 26 == 1:
            x, sub = w & 1023, w >> 11 & 1023
            if w >> 21 & 1:
                column = None
                if reference is not None:
                    if reference == used[0] and sub <= used[1]:
                        reference = None
                    elif x < width:
                        used, t, column = (reference, sub), 1000 * reference + sub, x
            elif column is not None:
                if x >= width:
                    column = None
                elif x <= column:
                    column = reference = None
                else:
                    column = x
        elif w >> 26 == 2:
            raw = w & 0x3FFFFF
            if last is None:
                newest = raw
            elif (raw - last) % 2**22 <= 60_000:
                newest += (raw - last) % 2**22
            elif pending is not None and (raw - pending) % 2**22 <= 60_000:
                newest += raw - last
            else:
                pending, reference, column = raw, None, None
                continue
            last, pending, reference = raw, None, newest
    return out


def _changes(keys: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    return np.flatnonzero(_flags(keys))


def _flags(keys: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Where any row of `keys` differs from the column before."""
    return np.append(True, np.any(keys[:, 1:] != keys[:, :-1], axis=0))
