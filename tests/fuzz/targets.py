"""What is fuzzed: every reader, its valid files to begin with, and what must hold of what it reads."""

from __future__ import annotations

import functools
import random
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numba
import numpy as np

from motion import bvh, sources
from motion.clip import Clip
from motion.errors import Note, UserError
from motion.skeleton import Skeleton

from . import documents, mutation

if TYPE_CHECKING:
    from mm.database import Database


class Defect(Exception):
    """A result or an error that is not as it must be."""


@dataclass(frozen=True)
class Target:
    """A reader under test.

    Attributes
    ----------
    suffix : of the file's name.
    seeds : makes valid files.
    read : reads a file of that name.
    check : a `Defect` unless the result makes sense.
    modules : files of the project, by their beginning, whose lines count as the reader's.
    words : of the format, for mutations.
    inside : a mutation of what is in the container, if the format is one.
    beside : files that must lie beside it: name to content.
    """

    suffix: str
    seeds: Callable[[], list[bytes]]
    read: Callable[[Path], Any]
    check: Callable[[Any], None]
    modules: tuple[str, ...]
    words: Sequence[bytes] = ()
    inside: Callable[[random.Random, bytes], bytes] | None = None
    beside: tuple[tuple[str, bytes], ...] = ()


def run(target: Target, data: bytes, folder: Path) -> str:
    """Read data as a file in folder: "read" or "refused"; anything else is a defect that is raised."""
    path = folder / f"file{target.suffix}"
    for name, content in target.beside:
        if not (folder / name).exists():
            (folder / name).write_bytes(content)
    path.write_bytes(data)
    with warnings.catch_warnings():
        warnings.simplefilter(
            "error"
        )  # a remark of NumPy's on the way is a defect, a note to the user is not
        warnings.simplefilter("ignore", Note)
        if numba.config.DISABLE_JIT:  # plain integers wrap as compiled ones do, but say so
            warnings.filterwarnings("ignore", "overflow encountered in scalar", RuntimeWarning)
        try:
            result = target.read(path)
        except UserError as error:
            _check_error(error, data)
            return "refused"
        target.check(result)
    return "read"


def spoil(target: Target, rng: random.Random, data: bytes, other: bytes = b"") -> bytes:
    """A changed file: inside its container, or its bytes."""
    if target.inside is not None and rng.random() < 0.7:
        for _ in range(rng.choice((1, 1, 2, 4))):
            data = target.inside(rng, data)
        return data
    return mutation.mutate(rng, data, target.words, other)


def _check_error(error: UserError, data: bytes) -> None:
    text = str(error)
    if error.path is None:
        raise Defect(f"an error that names no file: {text}")
    if len(text.splitlines()) != 1 or not text.isprintable() or len(text) > 1200 + len(error.path):
        raise Defect(f"an error that is not one printable line of some length: {text[:2000]!r}")
    blamed = Path(error.path)
    data = blamed.read_bytes() if blamed.is_file() else data  # it may be the file beside it
    if error.line is not None and not 1 <= error.line <= data.count(b"\n") + data.count(b"\r") + 2:
        raise Defect(f"an error at a line that the file does not have: {text}")


def _check_clip(clip: Clip) -> None:
    finite = np.isfinite(clip.positions).all() and np.isfinite(clip.rotations).all()
    if len(clip) == 0 or not finite:
        raise Defect(f"{clip!r} has no frames or is not finite")
    if np.abs(np.linalg.norm(clip.rotations, axis=-1) - 1).max() > 1e-6:
        raise Defect(f"{clip!r} has rotations that are not of unit length")
    if not (0 < clip.fps < 1e7 and 0 < clip.unit_to_m < 1e3):
        raise Defect(f"{clip!r} in units of {clip.unit_to_m} m")
    _check_skeleton(clip.skeleton)


def _check_clips(clips: Sequence[Clip]) -> None:
    if not clips:
        raise Defect("neither a clip nor an error")
    for clip in clips:
        _check_clip(clip)


def _check_skeleton(skeleton: Skeleton) -> None:
    if len(set(skeleton.names)) != len(skeleton) or not np.isfinite(skeleton.offsets).all():
        raise Defect(f"{skeleton!r} has names twice or offsets that are not finite")
    if not all(0 <= joint < len(skeleton) for joint in skeleton.roles.values()):
        raise Defect(f"{skeleton!r} has roles of joints that it does not have: {dict(skeleton.roles)}")


def _load_all(path: Path) -> Sequence[Clip]:
    return sources.load_all(path)


def _bvh() -> Target:
    def check(clip: Clip) -> None:
        _check_clip(clip)
        path = Path(clip.source or "")
        document = bvh.parse(path)
        path.write_bytes(bvh.serialise(document))
        again = bvh.parse(path)
        same = again.names == document.names and again.channels == document.channels
        if not same or not np.array_equal(again.values, document.values) or again.fps != document.fps:
            raise Defect("what was read is not what comes back when it is written")

    modules = ("motion/bvh/", "motion/digits.py", "motion/text.py")
    seeds = [documents.BVH, documents.BVH.replace(b"\n", b"\r\n")]
    return Target(".bvh", lambda: seeds, sources.load, check, modules, documents.BVH_WORDS)


def _asf() -> Target:
    from motion import asfamc

    return Target(
        ".asf",
        lambda: [documents.ASF],
        lambda path: asfamc.read(path.with_suffix(".amc"), path),
        _check_clip,
        ("motion/asfamc.py", "motion/text.py"),
        documents.ACCLAIM_WORDS,
        beside=(("file.amc", documents.AMC),),
    )


def _amc() -> Target:
    return Target(
        ".amc",
        lambda: [documents.AMC],
        sources.load,
        _check_clip,
        ("motion/asfamc.py", "motion/digits.py", "motion/text.py"),
        documents.ACCLAIM_WORDS,
        beside=(("file.asf", documents.ASF),),
    )


def _toml(seed: bytes, read: Callable[[Path], Any], *modules: str) -> Target:
    return Target(
        ".toml",
        lambda: [seed],
        read,
        lambda found: None,
        ("motion/config.py", *modules),
        documents.TOML_WORDS,
    )


def _glb() -> Target:
    seeds = [documents.gltf(binary=True)]
    modules = ("motion/gltf/",)
    return Target(".glb", lambda: seeds, _load_all, _check_clips, modules, inside=mutation.in_glb)


def _gltf() -> Target:
    seeds = [documents.gltf(binary=False)]
    modules = ("motion/gltf/",)
    return Target(".gltf", lambda: seeds, _load_all, _check_clips, modules, inside=mutation.in_json)


def _npz() -> Target:
    modules = ("motion/npz/",)
    seeds = documents.npz_files
    return Target(".npz", seeds, _load_all, _check_clips, modules, inside=mutation.in_zip)


def _roles() -> Target:
    from motion import roles

    return _toml(documents.ROLES, roles.load_overrides, "motion/roles/overrides.py")


def _schema() -> Target:
    from features import presets

    target = _toml(b"", presets.load, "features/schema.py")
    ready_made = lambda: [  # noqa: E731
        documents.written(presets.load(name).save) for name in ("mm27", "lmm27", "o3de59", "quadruped39")
    ]
    return Target(".toml", ready_made, target.read, target.check, target.modules, target.words)


def _settings() -> Target:
    from mm.settings import Settings
    from motion import config

    seed = config.dumps(Settings()).encode()
    return _toml(seed, functools.partial(config.load, Settings), "mm/settings.py")


def _course() -> Target:
    from mm import courses

    folder = Path(courses.__file__).parent
    seeds = lambda: [path.read_bytes() for path in sorted(folder.glob("*.toml"))]  # noqa: E731
    target = _toml(b"", courses.load, "mm/course.py", "mm/polyline.py")
    return Target(".toml", seeds, target.read, target.check, target.modules, target.words)


def _registry() -> Target:
    from motion.fetching import registry

    seed = (Path(registry.__file__).parent / "registry.toml").read_bytes()
    return _toml(seed, registry.load, "motion/fetching/registry.py")


def _tags() -> Target:
    from mm import tags

    words = (b",", b'"', b"\n", b"tag", b"clips", b"start", b"stop", b"tag,clips,start,stop\n")
    return Target(".csv", lambda: [documents.TAGS], tags.load, lambda found: None, ("mm/tags.py",), words)


def _tags_toml() -> Target:
    from mm import tags

    return _toml(documents.TAGS_TOML, tags.load, "mm/tags.py")


def _names() -> Target:
    from mm import interchange

    seeds = [documents.NAMES]
    return Target(".txt", lambda: seeds, interchange.load_names, lambda found: None, ("mm/interchange.py",))


def _small_database(**roles: int) -> Database:
    from features import presets
    from mm.database import Database
    from motion.pose import Poses

    parents, rotations = documents.chain()
    frames, joints, schema = *rotations.shape[:2], presets.load("lmm27")
    roles = {"root": 0, "hips": 1, "left_foot": 2, "right_foot": 3, **roles}
    skeleton = Skeleton(("root", "h", "l", "r"), np.array(parents), np.ones((joints, 3)), roles)
    vectors = np.zeros((frames, joints, 3), np.float32)
    columns = np.zeros((frames, schema.size), np.float32)
    return Database(
        skeleton=skeleton,
        fps=30.0,
        schema=schema,
        poses=Poses(vectors, rotations.astype(np.float32), vectors, vectors),
        contacts=np.zeros((frames, 2), np.uint8),
        contact_roles=("left_foot", "right_foot"),
        features=columns,
        offset=columns[0],
        scale=columns[0] + 1,
        starts=np.array([0, 3], np.int32),
        stops=np.array([3, 5], np.int32),
        names=("a", "b"),
        mirrored=np.array([False, True]),
        tags=np.zeros(frames, np.uint32),
        tag_names=("run",),
    )


def _database() -> Target:
    from mm.database import Database

    def seed() -> bytes:
        return documents.written(_small_database().save)

    def check(database: Database) -> None:
        _check_skeleton(database.skeleton)
        database.ranges()
        repr(database)

    modules = ("motion/files.py", "mm/database.py", "motion/skeleton.py")
    return Target(".mmdb", lambda: [seed()], Database.load, check, modules, inside=mutation.in_container)


def _recording() -> Target:
    from mm import courses
    from mm.recording import Recording

    def seed() -> bytes:
        parents, rotations = documents.chain()
        frames, joints = rotations.shape[:2]
        arrays = {
            "positions": np.zeros((frames, 1, joints, 3), np.float32),
            "rotations": rotations[:, None].astype(np.float32),
            "command_velocity": np.zeros((frames, 1, 2), np.float32),
            "command_yaw": np.zeros((frames, 1), np.float32),
        }
        skeleton = Skeleton(("root", "h", "l", "r"), np.array(parents), np.ones((joints, 3)), {"root": 0})
        recording = Recording(
            "mm",
            skeleton,
            60.0,
            arrays,
            course=courses.load("square"),
            path=np.zeros((3, 2)),
            step_seconds=np.zeros(frames),
            stages=("search",),
            stage_seconds=np.zeros((frames, 1)),
        )
        return documents.written(recording.save)

    def check(recording: Recording) -> None:
        _check_skeleton(recording.skeleton)
        repr(recording)

    modules = ("motion/files.py", "mm/recording.py", "motion/skeleton.py")
    return Target(".mmrec", lambda: [seed()], Recording.load, check, modules, inside=mutation.in_container)


def _reference() -> Target:
    from mm import interchange

    seeds = [documents.reference_database(short=short) for short in (False, True)]

    def check(raw: Any) -> None:
        if not np.isfinite(raw.positions).all():
            raise Defect("positions that are not finite")

    return Target(".bin", lambda: seeds, interchange.read_database, check, ("mm/interchange.py",))


def _features() -> Target:
    from mm import interchange

    seeds = [documents.reference_features()]
    read = interchange.read_features
    return Target(".bin", lambda: seeds, read, lambda found: None, ("mm/interchange.py",))


def _network() -> Target:
    import lmm_models

    from lmm import interchange
    from lmm.network import Network

    def check(network: Network) -> None:
        inputs, outputs = network.sizes[0], network.sizes[-1]
        with np.errstate(all="ignore"):  # numbers near the largest are numbers
            found = network.evaluate(np.zeros((2, inputs), np.float32))
        if found.shape != (2, outputs):
            raise Defect(f"{network!r} gives {found.shape}")

    seeds = [
        documents.written(functools.partial(interchange.write_network, network=lmm_models.network(*sizes)))
        for sizes in ((3, 2), (3, 4, 2), (2, 5, 5, 1))
    ]
    modules = ("lmm/interchange.py", "mm/interchange.py", "lmm/network.py")
    return Target(".bin", lambda: seeds, interchange.read_network, check, modules)


def _model() -> Target:
    import lmm_models

    from lmm.model import Model

    def seed(**roles: int) -> bytes:
        return documents.written(lmm_models.model(_small_database(**roles), latents=2, hidden=3).save)

    legs = {
        f"{side}_{joint}": j + 1 for side in ("left", "right") for j, joint in enumerate(("up_leg", "leg"))
    }

    def check(model: Model) -> None:
        _check_skeleton(model.description.skeleton)
        repr(model)
        model.memory()
        with np.errstate(all="ignore"):
            for network in model.networks.values():
                network.evaluate(np.zeros((2, network.sizes[0]), np.float32))

    modules = ("motion/files.py", "lmm/model.py", "lmm/network.py", "mm/description.py")
    return Target(
        ".lmm", lambda: [seed(), seed(**legs)], Model.load, check, modules, inside=mutation.in_container
    )


TARGETS: dict[str, Callable[[], Target]] = {
    "bvh": _bvh,
    "asf": _asf,
    "amc": _amc,
    "glb": _glb,
    "gltf": _gltf,
    "npz": _npz,
    "roles": _roles,
    "schema": _schema,
    "settings": _settings,
    "course": _course,
    "registry": _registry,
    "tags": _tags,
    "tags-toml": _tags_toml,
    "names": _names,
    "database": _database,
    "recording": _recording,
    "reference": _reference,
    "features": _features,
    "network": _network,
    "model": _model,
}


@functools.cache
def get(name: str) -> Target:
    """A target by name."""
    return TARGETS[name]()
