"""From mocap files to a database: read, fit, resample, ground, mirror, extract, normalise."""

from __future__ import annotations

import glob
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from features.schema import Schema
from motion import contacts as contact_detection
from motion import leadin, resample, root, sources, subset
from motion import mirror as mirroring
from motion import roles as role_maps
from motion.clip import Clip
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton

from . import parts, skeletons, suspects
from . import tags as tagging
from .database import Database
from .settings import Settings
from .work import Work

PathLike = str | os.PathLike[str]

MINIMUM_FRAMES = 3  # a velocity by central differences needs three
SKIP = "repair or remove it, or leave such clips out with --skip-bad"


def build(
    paths: PathLike | Sequence[PathLike],
    *,
    schema: str | Schema = "mm27",
    fps: float = 60.0,
    mirror: bool = True,
    jobs: int | None = None,
    skeleton: PathLike | Skeleton | None = None,
    roles_only: bool = False,
    roles: Mapping[str, str] | PathLike | None = None,
    source_fps: float | None = None,
    tags: PathLike | None = None,
    folder_tags: bool = False,
    skip_bad: bool = False,
    exclude: Sequence[str] = (),
    note: Callable[[str], None] | None = None,
    progress: Callable[..., Iterator[Any]] | None = None,
) -> Database:
    """Build a database from clips.

    Parameters
    ----------
    paths : clips and folders of clips.
    schema : a ready-made schema's name, a TOML file or a Schema.
    fps : the database's frames per second.
    mirror : whether every clip is followed by its mirrored copy.
    jobs : threads; default: one a core.
    skeleton : a file with the skeleton to use: clips with other joints are left out. Without it all clips
        must have the same joints. Other bone lengths are fitted to it, or to the first clip's.
    roles_only : use a flat skeleton of the joints that the schema needs, so that skeletons may differ.
    roles : overrides of the guessed roles: role to joint name, or a TOML file.
    source_fps : the clips' frame rate, where their files state a wrong one.
    tags : a file of tag rules, see `mm.tags`.
    folder_tags : give every clip a tag with its folder's name.
    skip_bad : leave clips out that cannot be used, with a note, instead of failing on the first.
    exclude : shell patterns of clips to leave out, by name or by path from the source on.
    note : called with each remark for the user, a line.
    progress : wraps the loops over clips, as `motion.console.progress` does.

    A folder without clips, a clip that cannot be read, is too short or not finite, clips without a common
    skeleton, a role that the schema needs and no joint plays, and a pattern to exclude that matches no clip
    are UserErrors.
    """
    work = Work.of(jobs, note, progress)
    if not 1 <= fps <= 1000:
        raise UserError(f"{fps:g} frames per second", remedy="give a rate between 1 and 1000")
    if roles_only and skeleton is not None:
        raise UserError(
            "a skeleton and roles only exclude each other", remedy="leave --skeleton or --roles-only out"
        )
    schema = schema if isinstance(schema, Schema) else Schema.load(schema)
    rules = tagging.load(tags) if tags is not None else ()
    if isinstance(roles, str | os.PathLike):
        roles = role_maps.load_overrides(roles)
    if skeleton is not None and not isinstance(skeleton, Skeleton):
        skeleton = load(Path(skeleton), source_fps, roles).skeleton

    dropped: dict[Path | None, int] = {}

    def read(path: Path) -> Clip:
        clip = load(path, source_fps, roles)
        dropped[path] = count = leadin.lead_in(clip)
        if count:
            clip = clip.replace(positions=clip.positions[count:], rotations=clip.rotations[count:])
        check(clip, schema, fps)
        return clip

    files = sources.find(paths, exclude=exclude)
    if exclude:
        every = len(sources.find(paths))
        work.note(f"{every - len(files)} of {every} clips are left out, as --exclude says")
    clips = _read(read, files, skip_bad, work)
    led = sum(dropped[clip.source] > 0 for clip in clips)
    if led:
        work.note(
            f"{led} of {len(clips)} clips begin with a rest pose that is no capture; its frames were dropped"
        )
    target = None
    if not roles_only:
        clips, target = skeletons.agree(clips, skeleton, work.note)
    names = _names(clips)
    if folder_tags:
        rules = (*rules, *_folder_rules(clips, names))
    tagging.check(rules, names, tags)
    for line in suspects.captures(clips, names, [dropped[clip.source] for clip in clips]):
        work.note(line)
    cuts = [tagging.Cut(clip.fps, dropped[clip.source], len(clip)) for clip in clips]

    grounded = _ground(clips, target, fps, work)
    _note_unmatchable(grounded, names, fps, work)
    bits = [tagging.mark(rules, *clip, fps) for clip in zip(names, cuts, map(len, grounded), strict=True)]
    flat = _flat(schema, grounded) if roles_only else None
    database = _assemble(grounded, names, bits, tagging.names(rules), schema, float(fps), mirror, flat, work)
    for line in suspects.contacts(database):
        work.note(line)
    return database


def _read(read: Callable[[Path], Clip], files: Sequence[Path], skip_bad: bool, work: Work) -> list[Clip]:
    bad: list[UserError] = []
    clips = list(work.map(read, files, label="read", keep=bad.append if skip_bad else None))
    for error in bad:
        work.note(f"left out: {error}")
    if not clips:
        raise UserError(f"no clip of {len(files)} can be used; the first: {bad[0]}")
    return clips


def load(path: Path, fps: float | None, roles: Mapping[str, str] | None) -> Clip:
    """A clip in metres with its roles, some of them told by joint names."""
    clip = sources.load(path, fps=fps)
    if not roles:
        return clip
    try:
        return clip.replace(skeleton=role_maps.apply(clip.skeleton, roles))
    except UserError as error:
        raise UserError(error.what, path=path, remedy=error.remedy) from error


def check(clip: Clip, schema: Schema, fps: float) -> None:
    """A clip too short, not finite or without the schema's joints is a UserError that names its file."""
    after = int(np.floor((len(clip) - 1) / clip.fps * fps + 1e-6)) + 1
    if min(len(clip), after) < MINIMUM_FRAMES:
        count = "1 frame" if len(clip) == 1 else f"{len(clip)} frames"
        what = f"a clip of {count} at {clip.fps:g} fps, at least {MINIMUM_FRAMES} at {fps:g} fps are needed"
        raise UserError(what, path=clip.source, remedy=SKIP)
    if after > resample.MOST_FRAMES:
        what = f"{len(clip)} frames at {clip.fps:g} fps are {after:,} at {fps:g} fps"
        remedy = f"at most {resample.MOST_FRAMES:,} fit; is the file's rate right (--source-fps)?"
        raise UserError(what, path=clip.source, remedy=remedy)
    for what, values in (("positions", clip.positions), ("rotations", clip.rotations)):
        if not np.isfinite(np.sum(values)):
            frame, joint = np.argwhere(~np.isfinite(values).all(axis=-1))[0]
            where = f"at frame {frame}, joint {clip.skeleton.names[joint]}"
            raise UserError(f"{what} are not finite {where}", path=clip.source, remedy=SKIP)
    parts.check_roles(schema, clip.skeleton, clip.source)


def _ground(clips: list[Clip], target: Skeleton | None, fps: float, work: Work) -> list[Clip]:
    """Clips at the database's rate, on one skeleton, under a ground root; empties the list given."""
    others = sum(target is not None and skeletons.differs(clip, target) for clip in clips)
    if others:
        work.note(f"{others} of {len(clips)} clips have other bone lengths and are fitted to one skeleton")

    def ground(clip: Clip) -> Clip:
        if target is not None:
            fits = not skeletons.differs(clip, target)
            clip = clip.replace(skeleton=target) if fits else subset.fit(clip, target)
        return root.ground(resample.resample(clip, fps))

    return list(work.map(_letting_go(ground, clips), range(len(clips)), label="prepare"))


def _letting_go(function: Callable[[Any], Any], items: list) -> Callable[[int], Any]:
    """A function of an index, that frees each item once it is used: two whole copies need not fit."""

    def call(i: int) -> Any:
        item, items[i] = items[i], None
        return function(item)

    return call


def _assemble(
    clips: list[Clip],
    names: Sequence[str],
    bits: Sequence[np.ndarray],
    tag_names: tuple[str, ...],
    schema: Schema,
    fps: float,
    mirror: bool,
    flat: Skeleton | None,
    work: Work,
) -> Database:
    """The database of grounded clips; empties the list given."""
    copies = 2 if mirror else 1
    counts = np.repeat([len(clip) for clip in clips], copies)
    stops = np.cumsum(counts).astype(np.int32)
    starts = (stops - counts).astype(np.int32)
    skeleton = flat or clips[0].skeleton
    contact_roles = parts.contact_roles(skeleton)
    if contact_roles and _on_all_fours(clips):
        contact_roles += contact_detection.HANDS
    poses = Poses.empty(int(stops[-1]), len(skeleton))
    contacts = np.zeros((len(poses), len(contact_roles)), np.uint8)
    plans = mirroring.plans(clips) if mirror else []

    def store(i: int) -> None:
        clip, clips[i] = clips[i], None  # type: ignore[call-overload]
        touching = contact_detection.contacts(clip, roles=contact_roles)
        for copy in range(copies):
            piece = slice(starts[copies * i + copy], stops[copies * i + copy])
            if copy:
                clip = mirroring.mirror(clip, plans[i])
                touching = touching[:, [contact_roles.index(role_maps.opposite(r)) for r in contact_roles]]
            contacts[piece] = touching
            found = Poses.of_clip(clip)
            poses[piece] = skeletons.flatten(clip.skeleton, found, skeleton) if flat else found

    for _ in work.map(store, range(len(clips)), label="store"):
        pass
    features, offset, scale = parts.compute_features(schema, skeleton, fps, poses, starts, stops)
    return Database(
        skeleton=skeletons.at_rest(skeleton, poses) if flat is None else skeleton,
        fps=fps,
        schema=schema,
        poses=poses,
        contacts=contacts,
        contact_roles=contact_roles,
        features=features,
        offset=offset,
        scale=scale,
        starts=starts,
        stops=stops,
        names=tuple(name for name in names for _ in range(copies)),
        mirrored=np.arange(len(starts)) % copies == 1,
        tags=np.concatenate([mark for mark in bits for _ in range(copies)]),
        tag_names=tag_names,
    )


def _on_all_fours(clips: Sequence[Clip]) -> bool:
    """Whether most clips, weighed by their lengths, are of animals on four legs."""
    votes = [
        len(clip)
        * (role_maps.on_all_fours(clip.skeleton, contact_detection.some_positions([clip], 20)) - 0.5)
        for clip in clips
    ]
    return sum(votes) > 0


def _flat(schema: Schema, clips: Sequence[Clip]) -> Skeleton:
    """The joints that the schema names and those that touch the ground."""
    hands = contact_detection.HANDS if _on_all_fours(clips) else ()
    return skeletons.flat((*schema.roles(), "left_foot", "right_foot", *hands))


def _names(clips: Sequence[Clip]) -> list[str]:
    """Clip names; those that occur twice are told apart by their folders, or else numbered."""
    names = [clip.name for clip in clips]
    folders = [sources.folders_of(clip.source) if clip.source else () for clip in clips]
    for depth in range(3):
        twice = {name for name, count in Counter(names).items() if count > 1}
        for i, name in enumerate(names):
            if name in twice and depth < len(folders[i]):
                names[i] = f"{folders[i][depth]}/{name}"
    seen: Counter[str] = Counter()
    for i, name in enumerate(names):
        seen[name] += 1
        if seen[name] > 1:
            names[i] = f"{name}#{seen[name]}"
    return names


def _folder_rules(clips: Sequence[Clip], names: Sequence[str]) -> list[tagging.Rule]:
    pairs = [
        (clip.source.resolve().parent.name, name)
        for clip, name in zip(clips, names, strict=True)
        if clip.source
    ]
    return [tagging.Rule(folder, glob.escape(name)) for folder, name in pairs if folder]


def _note_unmatchable(clips: Sequence[Clip], names: Sequence[str], fps: float, work: Work) -> None:
    """Searches skip the end of every range, so clips no longer than that are never found."""
    limit = round(Settings().ignore_end * fps)
    short = [name for name, clip in zip(names, clips, strict=True) if len(clip) <= limit]
    if short:
        work.note(
            f"{len(short)} of {len(names)} clips have {limit} frames or fewer (such as {short[0]}): "
            "a search with the default settings never finds them"
        )
