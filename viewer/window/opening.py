"""Whether a window can be opened here; what is missing is told in one line.

Open3D ends the whole program where it finds no display or no driver, so that all is asked for beforehand.
"""

from __future__ import annotations

import ctypes
import os
import sys

from motion import console
from motion.errors import UserError

# The packages' names are those of Debian and Ubuntu.
LIBRARIES = {
    "libusb-1.0.so.0": "libusb-1.0-0",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
    "libvulkan.so.1": "libvulkan1 mesa-vulkan-drivers",
    "libX11.so.6": "libx11-6",
}
_PROCESSOR = 4  # VK_PHYSICAL_DEVICE_TYPE_CPU
WITHOUT = "or draw without a window: --offscreen OUT.png"


def check() -> bool:
    """Whether a processor will draw, for want of a graphics card.

    A UserError where no window can be opened: no open3d, a library is missing, no display, no driver.
    """
    if not sys.platform.startswith("linux"):
        _check_open3d()
        return False
    _check_libraries()
    _check_open3d()
    _check_display()
    return _check_driver()


@console.needs("viewer", "open3d")
def _check_open3d() -> None:
    pass


def _check_libraries() -> None:
    for library, package in LIBRARIES.items():
        try:
            ctypes.CDLL(library)
        except OSError as error:
            remedy = f"apt-get install {package}, {WITHOUT}"
            raise UserError(f"no window: the system library {library} is missing", remedy=remedy) from error


def _check_display() -> None:
    name = os.environ.get("DISPLAY")
    x11 = ctypes.CDLL("libX11.so.6")
    x11.XOpenDisplay.restype, x11.XOpenDisplay.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    x11.XCloseDisplay.argtypes = [ctypes.c_void_p]
    display = x11.XOpenDisplay(None)
    if not display:
        what = f"the display {name} cannot be opened" if name else "there is no display"
        remedy = f"run it on a desktop, by xvfb-run -a, {WITHOUT}"
        raise UserError(f"no window: {what}", remedy=remedy)
    x11.XCloseDisplay(display)


class _Create(ctypes.Structure):
    """VkInstanceCreateInfo, of nothing but what it is."""

    _fields_ = (
        ("type", ctypes.c_int32),
        ("next", ctypes.c_void_p),
        ("flags", ctypes.c_uint32),
        ("application", ctypes.c_void_p),
        ("layers", ctypes.c_uint32),
        ("layer_names", ctypes.c_void_p),
        ("extensions", ctypes.c_uint32),
        ("extension_names", ctypes.c_void_p),
    )


def _check_driver() -> bool:
    vulkan, made = ctypes.CDLL("libvulkan.so.1"), ctypes.c_void_p()
    asked = _Create(type=1)  # VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO
    count = ctypes.c_uint32()
    found = vulkan.vkCreateInstance(ctypes.byref(asked), None, ctypes.byref(made)) == 0
    if found:
        vulkan.vkEnumeratePhysicalDevices(made, ctypes.byref(count), None)
    if not count.value:
        remedy = f"apt-get install mesa-vulkan-drivers, {WITHOUT}"
        raise UserError("no window: there is no graphics driver (Vulkan)", remedy=remedy)
    devices = (ctypes.c_void_p * count.value)()
    vulkan.vkEnumeratePhysicalDevices(made, ctypes.byref(count), devices)
    kinds = []
    for device in devices:
        about = (ctypes.c_uint32 * 1024)()  # VkPhysicalDeviceProperties: the fifth number is the kind
        vulkan.vkGetPhysicalDeviceProperties(ctypes.c_void_p(device), about)
        kinds.append(about[4])
    vulkan.vkDestroyInstance(made, None)
    return all(kind == _PROCESSOR for kind in kinds)
