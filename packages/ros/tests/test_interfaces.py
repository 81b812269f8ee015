"""Messages that are compiled: what happens without ROS 2; packages/ros/tests/real has the rest."""

import sys
from importlib.util import find_spec

import pytest

from wideberth import WideberthError
from wideberth_ros.interfaces import provide


def test_a_package_that_is_installed_is_left_alone() -> None:
    before = list(sys.path)
    provide(["numpy", "pytest"])
    assert sys.path == before


def test_an_unknown_package_is_refused_with_the_nearest() -> None:
    with pytest.raises(WideberthError, match="did you mean 'vision_msgs'"):
        provide(["vision_mgs"])


@pytest.mark.skipif(find_spec("rosidl_adapter") is not None, reason="ROS 2 is here")
def test_without_rosidl_the_error_names_what_to_install() -> None:
    with pytest.raises(WideberthError) as refused:
        provide(["nav2_msgs"])
    assert str(refused.value) == (
        "nav2_msgs is not installed, and to compile its messages rosidl (No module named "
        "'rosidl_adapter') is missing; install ros-$ROS_DISTRO-nav2-msgs, or "
        "rosidl-default-generators"
    )
