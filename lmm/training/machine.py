"""What torch computes on, and how exactly."""

from __future__ import annotations

import contextlib
import math
import os
import warnings
from collections.abc import Iterator
from importlib import metadata
from typing import Any

import torch

from motion.errors import UserError

from .settings import Common


def check_memory(needed: int) -> None:
    """A UserError where so many bytes are more than the machine has, before work that would end in vain."""
    has = memory()
    if needed > has:
        raise UserError(
            f"training takes about {needed / 1e9:.1f} GB of memory, this machine has {has / 1e9:.1f} GB",
            remedy="build a database of fewer clips, without mirrored copies, or at a lower frame rate",
        )


def memory() -> float:
    """Bytes of memory of the machine; infinite where the system does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return math.inf


def version() -> str:
    """This program's; "unknown" in a checkout that is not installed."""
    try:
        return metadata.version("motion-matching")
    except metadata.PackageNotFoundError:
        return "unknown"


@contextlib.contextmanager
def machine(settings: Common) -> Iterator[None]:
    """Torch as the settings want it, put back after: threads, precision of products, the same every time.

    Without the device that is asked for, or where its memory is full: a UserError.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of drivers: what they come to is told on the one line
        if settings.device == "cuda" and not torch.cuda.is_available():
            raise UserError("torch finds no CUDA device", remedy="train on the processor: --device cpu")
    threads, precision = torch.get_num_threads(), torch.get_float32_matmul_precision()
    deterministic = torch.are_deterministic_algorithms_enabled()
    warned = torch.is_deterministic_algorithms_warn_only_enabled()
    try:
        if settings.threads:
            torch.set_num_threads(settings.threads)
        torch.set_float32_matmul_precision("medium" if settings.precision == "bfloat16" else "highest")
        if settings.device == "cuda":
            os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
            torch.use_deterministic_algorithms(True, warn_only=True)
        yield
    except torch.OutOfMemoryError as error:
        remedy = "end what else uses it, give smaller batches, or train on the processor: --device cpu"
        raise UserError("the GPU's memory is full", remedy=remedy) from error
    finally:
        torch.set_num_threads(threads)
        torch.set_float32_matmul_precision(precision)
        torch.use_deterministic_algorithms(deterministic, warn_only=warned)


def facts(settings: Common) -> dict[str, Any]:
    """What a result depends on, to the bit, beside settings and data."""
    found = {"torch": torch.__version__, "processor": torch.backends.cpu.get_cpu_capability()}
    if settings.device == "cuda":
        return found | {"device": torch.cuda.get_device_name()}
    return found | {"threads": torch.get_num_threads()}
