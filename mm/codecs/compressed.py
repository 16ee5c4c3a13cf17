"""A compressed database: what a codec keeps of one, in a memory-mapped file of its own kind."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from features.schema import Schema
from motion import files, quat
from motion.pose import Poses
from motion.skeleton import Skeleton

from ..database import Database
from ..description import Description
from ..stages import plain
from . import features as feature_codecs
from . import kernels, root, smallest_three
from .codec import Codec, parse
from .encode import encode
from .tables import Tables, empty

KIND, VERSION = "compressed motion database", 1
CHUNK = 4096


@dataclass(eq=False, repr=False)
class Compressed:
    """T frames in R ranges, as `mm.database.Database` has them, of which poses are decoded when they play.

    Attributes
    ----------
    description : of the database that it was made from, whose fingerprint it bears.
    codec : how it is stored.
    tables : of the poses, see `mm.codecs.tables`.
    coded : arrays of the features, see `mm.codecs.features`.
    origins : float32 [R, 3], where the ground root begins each range: x, z (m) and yaw (rad).
    names, mirrored, tags : see `mm.database.Database`.
    errors : what `mm.codecs.errors.measure` found; empty where it was not measured.
    fingerprint : hash of all of it, as stored.
    """

    description: Description
    codec: Codec
    tables: Tables
    coded: dict[str, NDArray]
    origins: NDArray[np.float32]
    names: tuple[str, ...]
    mirrored: NDArray[np.bool_]
    tags: NDArray[np.uint32]
    errors: dict[str, Any] = field(default_factory=dict)
    fingerprint: str = ""

    def __repr__(self) -> str:
        size = f"{len(self)} frames in {len(self.starts)} ranges, {len(self.skeleton)} joints"
        return f"Compressed({size}, codec {self.codec.name!r}, features {self.codec.features!r})"

    def __len__(self) -> int:
        return int(self.stops[-1])

    @cached_property
    def features(self) -> NDArray[np.float32]:
        """Normalised features [T, F], decoded: what the search runs on."""
        return plain(feature_codecs.decode(self.coded, self.schema.size))

    @property
    def skeleton(self) -> Skeleton:
        return self.description.skeleton

    @property
    def fps(self) -> float:
        return self.description.fps

    @property
    def schema(self) -> Schema:
        return self.description.schema

    @property
    def starts(self) -> NDArray[np.int32]:
        return self.tables.starts

    @property
    def stops(self) -> NDArray[np.int32]:
        return self.tables.stops

    def ranges(self) -> NDArray[np.int32]:
        """Range index of every frame, int32 [T]."""
        return np.repeat(np.arange(len(self.starts), dtype=np.int32), self.stops - self.starts)

    def memory(self) -> dict[str, int]:
        """Bytes stored, by part; loaded, features are float32 besides what a search index takes."""
        _, description = self.description.to_parts()
        return self.tables.memory() | {
            "features": sum(array.nbytes for array in self.coded.values()),
            "tags": _packed_tags(self.tags, self.description.tag_names).nbytes,
            "description": sum(a.nbytes for a in (*description.values(), self.origins, self.mirrored)),
        }

    def decode(self, frames: NDArray[np.int32]) -> tuple[Poses, NDArray[np.uint8]]:
        """Poses [N], joint 0 the root's motion as `mm.stages.Decompression` has it, and contacts [N, C]."""
        joints, feet = len(self.skeleton), len(self.description.contact_roles)
        poses, contacts = Poses.empty(len(frames), joints), np.zeros((len(frames), feet), np.uint8)
        spare = Poses.empty(kernels.SPARE, joints)
        kernels.decode(
            np.ascontiguousarray(frames, np.int32), self.tables, spare.positions, spare.rotations,
            poses.positions, poses.rotations, poses.velocities, poses.angular_velocities, contacts,
        )  # fmt: skip
        return poses, contacts

    def decoded(self) -> Database:
        """All of it as a database, as large as the one that it was made from."""
        poses = Poses.empty(len(self), len(self.skeleton))
        contacts = np.zeros((len(self), len(self.description.contact_roles)), np.uint8)
        for start in range(0, len(self), CHUNK):
            piece = slice(start, min(start + CHUNK, len(self)))
            frames = np.arange(piece.start, piece.stop, dtype=np.int32)
            poses[piece], contacts[piece] = self.decode(frames)
        turns = quat.yaw(poses.rotations[:, 0].astype(np.float64))
        steps = np.column_stack([poses.positions[:, 0, [0, 2]], turns])
        way = root.follow(steps, self.origins, self.starts, self.stops)
        facing = quat.from_yaw(way[:, 2])
        poses.positions[:, 0] = np.column_stack([way[:, 0], np.zeros(len(way)), way[:, 1]])
        poses.rotations[:, 0] = facing
        poses.velocities[:, 0] = quat.rotate(facing, poses.velocities[:, 0].astype(np.float64))
        description = self.description
        return Database(
            skeleton=description.skeleton,
            fps=description.fps,
            schema=description.schema,
            poses=poses,
            contacts=contacts,
            contact_roles=description.contact_roles,
            features=self.features,
            offset=description.offset,
            scale=description.scale,
            starts=self.starts,
            stops=self.stops,
            names=self.names,
            mirrored=self.mirrored,
            tags=self.tags,
            tag_names=description.tag_names,
            fingerprint=self.fingerprint,
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write atomically; sets and stores the fingerprint."""
        described, described_arrays = self.description.to_parts()
        metadata = {
            "description": described,
            "codec": asdict(self.codec),
            "names": list(self.names),
            "errors": self.errors,
        }
        arrays = {
            **{f"description.{name}": array for name, array in described_arrays.items()},
            **{f"poses.{name}": array for name, array in self.tables.arrays().items()},
            **{f"features.{name}": array for name, array in self.coded.items()},
            "origins": self.origins,
            "mirrored": self.mirrored,
            "tags": _packed_tags(self.tags, self.description.tag_names),
        }
        self.fingerprint = files.save(path, KIND, VERSION, metadata, arrays)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Compressed:
        """Read one, memory-mapped. Errors: see `motion.files.load`."""
        metadata, arrays, fingerprint = files.load(path, KIND, VERSION)
        with files.content_of(path, KIND):
            described = Description.from_parts(metadata["description"], _part(arrays, "description."))
            codec = Codec(**metadata["codec"])
            if parse(codec.name, features=codec.features) != codec:
                raise ValueError(f"no codec {codec.name!r}")
            tables = empty(len(described.skeleton), described.fps, codec.bits)
            tables = tables.having(_part(arrays, "poses."))
            coded, frames = _part(arrays, "features."), int(tables.stops[-1])
            _check(tables, coded, arrays, codec, described, frames)
            tags = arrays["tags"].astype(np.uint32) if len(arrays["tags"]) else np.zeros(frames, np.uint32)
            compressed = Compressed(
                description=described,
                codec=codec,
                tables=tables,
                coded=coded,
                origins=arrays["origins"],
                names=tuple(metadata["names"]),
                mirrored=arrays["mirrored"],
                tags=tags,
                errors=dict(metadata["errors"]),
                fingerprint=fingerprint,
            )
            if len(compressed.names) != len(compressed.starts):
                raise ValueError(f"{len(compressed.names)} names of {len(compressed.starts)} ranges")
        return compressed


def compress(database: Database, codec: Codec | str, *, rigs: bool = True) -> Compressed:
    """A database compressed by a codec, or one of a name (`mm.codecs.codec.parse`).

    Without rigs it cannot drive rigs, and takes less time. See `encode` for errors.
    """
    codec = parse(codec) if isinstance(codec, str) else codec
    return Compressed(
        description=Description.of(database, rigs=rigs),
        codec=codec,
        tables=encode(database, codec),
        coded=feature_codecs.encode(database.features, codec.features),
        origins=root.path(database)[database.starts].astype(np.float32),
        names=database.names,
        mirrored=database.mirrored,
        tags=plain(database.tags),
    )


def _packed_tags(tags: NDArray[np.uint32], names: tuple[str, ...]) -> NDArray:
    """Tags [T] in as few bytes as their names need, none if there are none."""
    kinds = {0: np.uint8, 1: np.uint8, 2: np.uint16, 3: np.uint32, 4: np.uint32}
    return tags[: len(tags) if names else 0].astype(kinds[-(-len(names) // 8)])


def _part(arrays: Mapping[str, NDArray], prefix: str) -> dict[str, NDArray]:
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def _check(
    tables: Tables,
    coded: Mapping[str, NDArray],
    arrays: Mapping[str, NDArray],
    codec: Codec,
    description: Description,
    frames: int,
) -> None:
    """A ValueError unless all arrays fit each other: a decoder must not read outside of them."""
    joints, ranges, feet = len(description.skeleton), len(tables.starts), len(description.contact_roles)
    edges = np.append(tables.starts, frames)
    files.check_shapes(tables.arrays(), {"starts": ("int32", (ranges,)), "stops": ("int32", (ranges,))})
    if not frames or edges[0] != 0 or np.any(np.diff(edges) <= 0) or np.any(edges[1:] != tables.stops):
        raise ValueError(f"its ranges do not cover its {frames} frames one after another")
    rows = frames if codec.keyframes is None else len(tables.keys)
    kind = codec.numbers
    count = {name: rows if kind == name else 0 for name in ("float32", "float16", "quantised")}
    rated = {name: 0 if codec.recomputed or kind != name else frames for name in ("float32", "float16")}
    rooted = {name: frames if kind == name else 0 for name in count}
    turning, moving = len(tables.turning), len(tables.moving)
    width = -(-turning * smallest_three.width(codec.bits) // 8) if count["quantised"] else 0
    whole = joints if count["quantised"] else 0
    files.check_shapes(
        tables.arrays(),
        {
            "floats": ("float32", (count["float32"], joints - 1, 7)),
            "halves": ("uint16", (count["float16"], joints - 1, 7)),
            "packed": ("uint8", (count["quantised"], width)),
            "turning": ("int32", (turning,)),
            "translations": ("uint16", (count["quantised"], moving)),
            "moving": ("int32", (moving,)),
            "offset": ("float32", (moving,)),
            "scale": ("float32", (moving,)),
            "bones": ("float32", (whole, 3)),
            "rest": ("float32", (whole, 4)),
            "keys": ("int32", (len(tables.keys),)),
            "rates": ("float32", (rated["float32"], joints - 1, 6)),
            "half_rates": ("uint16", (rated["float16"], joints - 1, 6)),
            "root": ("float32", (rooted["float32"], 6)),
            "half_root": ("uint16", (rooted["float16"], 6)),
            "coded_root": ("int16", (rooted["quantised"], 6)),
            "root_scale": ("float32", (6,)),
            "contacts": ("uint8", (-(-frames * feet // 8),)),
        },
    )
    for name, first, past in (("turning", 1, joints), ("moving", 3, 3 * joints)):
        values = getattr(tables, name)
        if np.any((values < first) | (values >= past)):
            raise ValueError(f"{name} joints that the skeleton does not have")
    if codec.keyframes is not None:
        keys = tables.keys
        ends = np.concatenate([tables.starts, tables.stops - 1])
        if np.any(np.diff(keys) <= 0) or not np.isin(ends, keys).all() or keys[-1] != frames - 1:
            raise ValueError("its key frames are not ascending, or lack the ends of ranges")
    elif len(tables.keys):
        raise ValueError("key frames that its codec does not have")
    files.check_shapes(coded, feature_codecs.expected(codec.features, frames, description.schema.size))
    if codec.features == "pq":
        centroids, codes = coded["centroids"], coded["codes"]
        if (
            centroids.shape[0] != codes.shape[1]
            or centroids.shape[2:] != (3,)
            or codes.max() >= centroids.shape[1]
        ):
            raise ValueError(f"codes {codes.shape} of centroids {centroids.shape}")
    tagged = frames if description.tag_names else 0
    if arrays["tags"].shape != (tagged,) or arrays["tags"].dtype.kind != "u":
        raise ValueError(f"tags are {arrays['tags'].dtype} {arrays['tags'].shape}")
    files.check_shapes(arrays, {"origins": ("float32", (ranges, 3)), "mirrored": ("bool", (ranges,))})
