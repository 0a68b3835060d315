"""Convert frames and graded apples to messages."""

from array import array
from collections.abc import Sequence
from typing import Final

import cv2
from apple_quality_msgs.msg import AppleQuality, AppleQualityArray
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from perception.frames import Picture
from perception.grading.grader import GradedApple
from perception.grading_loop import GradingStatus
from perception.intrinsics import Intrinsics

JPEG_QUALITY: Final = 85


def image(picture: Picture, header: Header) -> Image:
    """Return an rgb8 image."""
    height, width, _ = picture.shape
    message = Image(header=header, height=height, width=width, encoding="rgb8", step=3 * width)
    message.data = array("B", picture.tobytes())  # rclpy would check each element of a list or tuple.
    return message


def compressed(picture: Picture, header: Header) -> CompressedImage:
    """Return a JPEG image."""
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    data = cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))[1]
    message = CompressedImage(header=header, format="rgb8; jpeg compressed bgr8")
    message.data = array("B", data.tobytes())
    return message


def camera_info(intrinsics: Intrinsics, header: Header) -> CameraInfo:
    """Return the calibration of a camera."""
    return CameraInfo(
        header=header,
        width=intrinsics.width,
        height=intrinsics.height,
        distortion_model=intrinsics.distortion_model,
        d=[float(value) for value in intrinsics.distortion],
        k=intrinsics.matrix.reshape(-1),
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=intrinsics.projection.reshape(-1),
    )


def apple_array(apples: Sequence[GradedApple], header: Header) -> AppleQualityArray:
    """Return the message with the apples' values, in the order of ``pose_array``. For an ungraded apple, the grade is
    an empty string."""
    return AppleQualityArray(
        header=header,
        apples=[
            AppleQuality(
                grade=apple.grade,
                diameter_mm=float(apple.diameter_mm),
                red_ratio=float(apple.red_ratio),
                defect_score=float(apple.defect_score),
            )
            for apple in apples
        ],
    )


def pose_array(apples: Sequence[GradedApple], header: Header) -> PoseArray:
    """Return the message with the centers of the apples in the base_link frame."""
    return PoseArray(header=header, poses=[_pose(apple) for apple in apples])


def diagnostics(name: str, status: GradingStatus, stamp: Time) -> DiagnosticArray:
    """Return the diagnostic status of the camera and the grading. As long as the camera works, each frame is graded."""
    level = DiagnosticStatus.OK if status.working else DiagnosticStatus.ERROR
    message = status.message if status.working else f"no images are graded: {status.message}"
    values = [KeyValue(key=key, value=value) for key, value in status.values.items()]
    entry = DiagnosticStatus(level=level, name=name, message=message, hardware_id="camera", values=values)
    return DiagnosticArray(header=Header(stamp=stamp), status=[entry])


def _pose(apple: GradedApple) -> Pose:
    x, y, z = (float(value) for value in apple.position_m)
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(w=1.0))
