"""The ``roller`` command, launching, replay, recording and playing."""
