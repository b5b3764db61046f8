"""What a browser says first: viser admits a client, and begins to speak, when it tells its camera."""

from typing import Any

CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [3.0, 3.0, 3.0],
    "fov": 1.3,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 800,
    "image_width": 880,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 1.0, 0.0],
}
"""Of a window of usual size; for clients without a browser (`bots_wire`, `doctor_session`, tests)."""
