"""The camera's calibration from a `camerainfo_url`."""

from __future__ import annotations

from urllib.parse import unquote, urlparse

from roller_core.camera import Camera, CameraError

from . import protocol


def load_camera_info(url: str) -> Camera:
    """Read a ROS camera_info YAML file.

    Parameters
    ----------
    url : str
        A path, or a `file://` URL.

    Raises
    ------
    CameraError
        If the URL is of another kind, or the file can't be read or is of another sensor.
    """
    path = url
    if "://" in url:
        parts = urlparse(url)
        if parts.scheme != "file" or parts.netloc not in ("", "localhost"):
            raise CameraError(
                f"camerainfo_url '{url}': only paths and file:// URLs can be read; give "
                "file:///path/to/camera.yaml"
            )
        path = unquote(parts.path)
    camera = Camera.from_yaml(path)
    if (camera.width, camera.height) != (protocol.WIDTH, protocol.HEIGHT):
        raise CameraError(
            f"camera {path}: it is of a {camera.width}x{camera.height} sensor, this one has "
            f"{protocol.WIDTH}x{protocol.HEIGHT} pixels"
        )
    return camera
