"""Finding, opening and setting up the camera, against its model."""

from pathlib import Path

import pytest

from driver.emulation.camera_model import CameraModel
from driver.emulation.usb_backend import EmulatedBackend
from roller_core.errors import SettingsError
from roller_driver.dvxplorer import protocol as p
from roller_driver.dvxplorer import sequences
from roller_driver.dvxplorer.backends import load_backend
from roller_driver.dvxplorer.camera_settings import SensorSettings
from roller_driver.dvxplorer.discovery import UDEV_RULE, open_camera
from roller_driver.dvxplorer.errors import (
    BackendError,
    CameraBusyError,
    CameraControlError,
    CameraFault,
    CameraNotFoundError,
    CameraPermissionError,
    EndpointMissingError,
    UnknownFirmwareError,
    WrongDeviceError,
)


def started(model, settings=None):
    camera = open_camera(EmulatedBackend(model))
    camera.configure(settings or SensorSettings())
    camera.prepare()
    camera.run()
    return camera


def writes(model, module):
    return [(index, value) for kind, m, index, value in model.log if (kind, m) == ("write", module)]


def test_new_firmware_is_started_as_the_vendor_does():
    model = CameraModel(firmware=10)
    camera = started(model)
    assert model.streaming
    assert writes(model, 1) == [
        (13, 8), (14, 9), (15, 9), (4, 0), (5, 0), (6, 0), (8, 1), (9, 0), (10, 0), (19, 0),
        (20, 0), (21, 640), (22, 480), (23, 0), (11, 1), (12, 2000), (24, 0), (23, 0), (25, 0),
        (23, 0), (3, 1),
    ]  # fmt: skip
    assert writes(model, 3) == [
        (5, 11), (7, 5), (6, 2), (8, 11), (10, 2), (9, 2), (2, 1), (3, 1), (4, 1),
    ]  # fmt: skip
    reads = [(m, i) for kind, m, i, _ in model.log if kind == "read"]
    assert reads == [(1, 0), (1, 1), (3, 0), (1, 2), (1, 2)]
    model.log.clear()
    camera.close()
    assert not model.streaming
    assert [e[1:] for e in model.log] == [(1, 3, 0), (3, 2, 0), (3, 3, 0), (3, 4, 0)]


def test_old_firmware_is_started_as_the_vendor_does():
    model = CameraModel(firmware=9)
    camera = started(model)
    assert model.streaming
    registers = writes(model, 5)
    assert dict(registers) | {
        0x18: 0x04, 0x0C: 0x14, 0x0B: 0x06, 0x12: 0x7D, 0x1C: 0x00, 0x1E: 0x08,
    } == dict(registers)  # fmt: skip
    assert registers[-4:] == [(0x3201, 2), (0x3238, 1), (0x3238, 0), (0x3000, 2)]
    assert ("clear_halt", 0x82, 0, 0) in model.log
    model.log.clear()
    camera.close()
    assert [e[1:] for e in model.log] == [
        (5, 0x3000, 0), (1, 3, 0), (3, 2, 0), (3, 3, 0), (3, 4, 0),
    ]  # fmt: skip


@pytest.mark.parametrize("level", range(5))
def test_sensitivity_reaches_both_generations(level):
    settings = SensorSettings(bias_sensitivity=level)
    old = {s.parameter: s.value for s in sequences.configure(8, settings)}
    assert old[0x1C] == (0x06, 0x03, 0x00, 0x05, 0x02)[level]
    assert old[0x1E] == (0x02, 0x05, 0x08, 0x03, 0x06)[level]
    assert old[0x0B] == (0x06, 0x06, 0x06, 0x04, 0x04)[level]
    assert old[0x12] == (0x7D, 0x7D, 0x7D, 0x7F, 0x7F)[level]
    model = CameraModel()
    started(model, settings)
    on, off = model.values[1, 14], model.values[1, 15]
    assert on == off == (15, 12, 9, 6, 3)[level]


def test_settings_reach_new_firmware():
    model = CameraModel()
    started(model, SensorSettings(
        roi_enabled=True, roi_start_col=100, roi_end_col=299, roi_start_row=7, roi_end_row=16,
        contrast_threshold_on=17, contrast_threshold_off=0, polarity_off_only=True,
        readout_rate="constant_1000"))  # fmt: skip
    values = {i: model.values[1, i] for i in (4, 13, 14, 15, 19, 20, 21, 22)}
    assert values == {4: 3, 13: 3, 14: 17, 15: 0, 19: 100, 20: 7, 21: 200, 22: 10}


@pytest.mark.parametrize(
    ("rows", "expected"),
    [((0, 479), (0, 0xFF, 59, 0xFF)), ((3, 20), (0, 0xF8, 2, 0x1F)), ((9, 12), (1, 0xFF, 1, 0x1E))],
)
def test_region_of_old_firmware_is_sent_in_groups_of_rows(rows, expected):
    settings = SensorSettings(
        roi_enabled=True, roi_start_row=rows[0], roi_end_row=rows[1], roi_end_col=300
    )
    sent = {s.parameter: s.value for s in sequences.configure(9, settings)}
    assert tuple(sent[r] for r in range(0x3301, 0x3305)) == expected
    assert (sent[0x3300], sent[0x3307], sent[0x3308]) == (0, 1, 44)


def test_region_follows_a_sensor_mounted_the_other_way_round():
    model = CameraModel(firmware=8)
    model.values[1, 2] = 3
    started(model, SensorSettings(roi_enabled=True, roi_end_col=9, roi_end_row=7))
    v = {r: model.values[5, r] for r in range(0x3301, 0x3309)}
    assert (v[0x3305] << 8 | v[0x3306], v[0x3307] << 8 | v[0x3308]) == (630, 639)
    assert (v[0x3301], v[0x3303]) == (59, 59)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"readout_rate": "fast"}, "readout_rate 'fast' is not one of constant_100"),
        ({"bias_sensitivity": 5}, "at most 4 is expected"),
        ({"roi_enabled": True, "roi_start_col": 9, "roi_end_col": 3}, "ends before it starts"),
        ({"polarity_on_only": True, "polarity_flatten": True}, "only one of"),
    ],
)
def test_settings_that_make_no_sense_are_refused(values, says):
    with pytest.raises(SettingsError, match=says):
        SensorSettings.create(values)


def test_the_camera_is_chosen_by_its_serial_number():
    models = [CameraModel(serial="A1"), CameraModel(serial="B2")]
    backend = EmulatedBackend(*models)
    assert open_camera(backend).serial == "A1"
    assert open_camera(backend, "B2").serial == "B2"
    with pytest.raises(CameraNotFoundError, match="serial number 'C3'; plugged in: A1, B2"):
        open_camera(backend, "C3")


@pytest.mark.parametrize(
    ("model", "state", "fault", "says"),
    [
        (None, None, CameraNotFoundError, "no USB device 152a:8419"),
        (CameraModel(model=0), None, WrongDeviceError, "DVX00042 is not a DVXplorer Mini"),
        (CameraModel(firmware=7), None, UnknownFirmwareError, "firmware 7 is not known"),
        (CameraModel(), "held", CameraBusyError, "another program holds it"),
        (CameraModel(), "forbidden", CameraPermissionError, f"sudo cp config/{UDEV_RULE} /etc/ud"),
    ],
)
def test_a_camera_that_cannot_be_opened(model, state, fault, says):
    backend = EmulatedBackend(*([model] if model else []))
    if state:
        setattr(backend, state, True)
    with pytest.raises(fault, match=says):
        open_camera(backend)


@pytest.mark.parametrize("state", ["another model", "held", "forbidden"])
def test_a_camera_that_can_be_opened_is_found_behind_one_that_can_not(state):
    first = CameraModel(serial="A1", model=0 if state == "another model" else 4)
    backend = EmulatedBackend(first, CameraModel(serial="B2"))
    if state in ("held", "forbidden"):
        setattr(backend, state, {"A1"})
    assert open_camera(backend).serial == "B2"
    assert open_camera(backend, "B2").serial == "B2"
    if state != "another model":
        with pytest.raises(CameraFault):
            open_camera(backend, "A1")


@pytest.mark.parametrize(
    ("firmware", "where", "value", "says"),
    [
        (9, (6, 0), 17, "logic version is 17, known is 18"),
        (9, (6, 7), 1, "logic patch is 1, known is 2"),
        (10, (1, 0), 320, "sensor width is 320, known is 640"),
    ],
)
def test_a_camera_that_answers_strangely(firmware, where, value, says):
    model = CameraModel(firmware=firmware)
    model.values[where] = value
    with pytest.raises(UnknownFirmwareError, match=says):
        started(model)


def test_reads_that_are_never_answered_are_passed_over():
    model = CameraModel(unanswered={(1, 2), (3, 0)})
    started(model)
    assert model.streaming


def test_the_logic_version_must_be_answered():
    with pytest.raises(CameraControlError, match="logic version"):
        started(CameraModel(firmware=8, unanswered={(6, 0)}))


def test_the_rule_is_shipped_and_names_the_camera():
    text = (Path(__file__).parents[2] / "config" / UDEV_RULE).read_text()
    assert f'ATTR{{idVendor}}=="{p.VENDOR_ID:04x}"' in text
    assert f'ATTR{{idProduct}}=="{p.PRODUCT_ID:04x}"' in text


def test_an_endpoint_that_comes_late_or_elsewhere(monkeypatch):
    assert open_camera(EmulatedBackend(CameraModel(endpoint_delay_s=0.3)))
    model = CameraModel(alternate=1)
    open_camera(EmulatedBackend(model))
    assert ("alternate", 0, 1, 0) in model.log
    monkeypatch.setattr("roller_driver.dvxplorer.discovery._ENDPOINT_WAIT_S", 0.2)
    with pytest.raises(EndpointMissingError, match="no endpoint 0x82"):
        open_camera(EmulatedBackend(CameraModel(endpoint_delay_s=1e9)))


@pytest.mark.parametrize("name", ["nowhere:x", "os:nothing", "os", "os.path:join"])
def test_a_backend_that_cannot_be_loaded(name):
    with pytest.raises(BackendError, match=f"'{name}' can't be loaded"):
        load_backend(name)
