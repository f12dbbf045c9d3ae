"""Programs that read the camera through the real libusb: our driver, and the vendor's library.

    python -m driver.emulation.usb_clients ours|vendors COUNT OUTPUT.npz

They write the first COUNT events.
"""

import sys
import time

import numpy as np

from roller_core.events import EventArray

LIMIT_S = 30.0


def ours(count: int) -> tuple[EventArray, float]:
    """Read with our driver; events and seconds."""
    from roller_driver.dvxplorer.backends import load_backend
    from roller_driver.dvxplorer.camera_settings import SensorSettings
    from roller_driver.dvxplorer.discovery import open_camera
    from roller_driver.dvxplorer.packets import EventPart
    from roller_driver.dvxplorer.reader import CameraReader

    parts: list[EventPart] = []

    def connect():
        camera = open_camera(load_backend(""))
        camera.configure(SensorSettings())
        return camera

    reader = CameraReader(connect, parts.append, on_change=lambda *c: print(*c, flush=True))
    reader.start()
    end = time.monotonic() + LIMIT_S
    begin = 0.0
    while reader.status.decoder.events < count and time.monotonic() < end:
        if not begin and reader.status.usb.bytes:
            begin = time.monotonic()
        time.sleep(0.005)
    seconds = time.monotonic() - begin
    reader.stop()
    print(reader.status, flush=True)
    return EventArray.concatenate([part.events for part in parts]), seconds


def vendors(count: int) -> tuple[EventArray, float]:
    """Read with dv-processing; events and seconds."""
    import dv_processing as dv

    camera = dv.io.camera.open()
    print(camera.getCameraName(), camera.getEventResolution(), flush=True)
    parts = []
    got = 0
    end, begin = time.monotonic() + LIMIT_S, time.monotonic()
    while got < count and time.monotonic() < end:
        batch = camera.getNextEventBatch()
        if batch is None or not len(batch):
            time.sleep(0.002)
            continue
        a = batch.numpy()
        got += len(a)
        t = a["timestamp"].astype(np.int64) * 1000
        parts.append(EventArray.from_arrays(a["x"], a["y"], t, a["polarity"]))
    return EventArray.concatenate(parts), time.monotonic() - begin


if __name__ == "__main__":
    who, number, output = sys.argv[1:]
    events, seconds = {"ours": ours, "vendors": vendors}[who](int(number))
    np.savez(output, x=events.x, y=events.y, t_ns=events.t_ns, p=events.p, seconds=seconds)
