"""From mocap files to a database: read, check, resample, retarget, ground, mirror, extract, normalise."""

from __future__ import annotations

import glob
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from features import presets
from features.schema import Schema
from motion import contacts as contact_detection
from motion import facts, resample, root, sources
from motion import mirror as mirroring
from motion import roles as role_maps
from motion.anatomy import Anatomy
from motion.clip import Clip
from motion.errors import UserError
from motion.pose import Poses
from motion.skeleton import Skeleton

from . import intake, parts, skeletons, suspects
from . import tags as tagging
from .database import Database
from .intake import Piece, Report
from .settings import Settings
from .work import Work

PathLike = str | os.PathLike[str]


def build(
    paths: PathLike | Sequence[PathLike],
    *,
    schema: str | Schema = "mm27",
    fps: float = 60.0,
    mirror: bool = True,
    jobs: int | None = None,
    skeleton: PathLike | Skeleton | None = None,
    retarget: bool = True,
    roles_only: bool = False,
    check: bool = True,
    clips: PathLike | None = None,
    roles: Mapping[str, str] | PathLike | None = None,
    source_fps: float | None = None,
    source_unit: float | str | None = None,
    source_up: str = "y",
    source_forward: str | None = None,
    source_handedness: str = "right",
    tags: PathLike | None = None,
    folder_tags: bool = False,
    skip_bad: bool = False,
    exclude: Sequence[str] = (),
    report: Report | None = None,
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
    skeleton : the skeleton to use: that of a motion file, of `mm.skeletons.BUILT_IN` by name, or one itself.
        Without it all clips must have the same joints, and the first clip's bones serve.
    retarget : whether clips with other joints are moved onto the skeleton by roles, or left out. Same joints
        of other lengths are fitted.
    roles_only : use a flat skeleton of the joints that the schema needs, so that skeletons may differ.
    check : whether `motion.check` looks at every clip, and what it finds to be bad is cut out.
    clips : a file of rules about some of the clips, see `motion.facts`; besides those in the folders.
    roles : overrides of the guessed roles: role to joint name, or a TOML file.
    source_fps, source_unit, source_up, source_forward, source_handedness : the clips' frame rate, unit and
        axes, where their files state wrong ones or none. Rules about a clip go before these.
    tags : a file of tag rules, see `mm.tags`.
    folder_tags : give every clip a tag with its folder's name.
    skip_bad : leave clips out that cannot be read or used, with a note, instead of failing on the first.
    exclude : shell patterns of clips to leave out, by name or by path from the source on.
    report : filled with what was found and what is left out.
    note : called with each remark for the user, a line.
    progress : wraps the loops over clips, as `motion.console.progress` does.

    Clips of which the check leaves several pieces become several ranges, called after the frames that they
    are in the file: ``walk@0-120``, ``walk@131-300``.

    A folder without clips, a clip that cannot be read, is too short or not finite, clips without a common
    skeleton, a role that the schema needs and no joint plays, and a pattern that matches no clip are
    UserErrors.
    """
    work = Work.of(jobs, note, progress)
    report = Report() if report is None else report
    if not 1 <= fps <= 1000:
        raise UserError(f"{fps:g} frames per second", remedy="give a rate between 1 and 1000")
    if roles_only and skeleton is not None:
        raise UserError(
            "a skeleton and roles only exclude each other", remedy="leave --skeleton or --roles-only out"
        )
    schema = schema if isinstance(schema, Schema) else presets.load(schema)
    rules = tagging.load(tags) if tags is not None else ()
    common = facts.of_all(
        fps=source_fps,
        unit=source_unit,
        up=source_up,
        forward=source_forward,
        handedness=source_handedness,
        roles=roles,
    )
    files, book = _files(paths, exclude, clips, common, work)
    wanted = _wanted(skeleton, book)

    pieces = intake.take(files, book, fps=fps, checked=check, skip_bad=skip_bad, work=work, report=report)
    bodies: list[Anatomy | None] = [None] * len(pieces)
    target = None
    if not roles_only:
        pieces, bodies, target = skeletons.agree(
            pieces, wanted, retargeting=retarget, report=report, note=work.note
        )
        parts.check_roles(schema, target.skeleton, pieces[0].clip.source)
    else:
        for piece in pieces:
            parts.check_roles(schema, piece.clip.skeleton, piece.clip.source)
    names = _names(pieces)
    if folder_tags:
        rules = (*rules, *_folder_rules(pieces, names))
    tagging.check(rules, names, tags)
    cuts = [tagging.Cut(p.clip.fps, p.start, p.stop, p.frames) for p in pieces]
    clips_in = [piece.clip for piece in pieces]
    del pieces

    grounded = _ground(clips_in, bodies, target, fps, work)
    labels = [own for own, _ in names]
    _note_unmatchable(grounded, labels, fps, work)
    bits = [tagging.mark(rules, *clip, fps) for clip in zip(names, cuts, map(len, grounded), strict=True)]
    flat = _flat(schema, grounded) if roles_only else None
    database = _assemble(grounded, labels, bits, tagging.names(rules), schema, float(fps), mirror, flat, work)
    for line in suspects.contacts(database):
        work.note(line)
    return database


def of_clips(
    clips: Iterable[Clip], *, schema: str | Schema = "mm27", mirror: bool = True, jobs: int | None = 1
) -> Database:
    """A database of clips that need neither files nor checks: all of one skeleton, at its rate, in metres.

    They are taken one after another and held only once, so that a generator may make many.
    """
    schema = schema if isinstance(schema, Schema) else presets.load(schema)
    grounded = [root.ground(clip) for clip in clips]
    if not grounded:
        raise UserError("no clips", remedy="give at least one")
    parts.check_roles(schema, grounded[0].skeleton, None)
    names, fps = [clip.name for clip in grounded], grounded[0].fps
    untagged = [np.zeros(len(clip), np.uint32) for clip in grounded]
    return _assemble(grounded, names, untagged, (), schema, fps, mirror, None, Work.of(jobs))


def _files(
    paths: PathLike | Sequence[PathLike],
    exclude: Sequence[str],
    clips: PathLike | None,
    common: facts.Facts,
    work: Work,
) -> tuple[list[Path], facts.Book]:
    """The files to read, and what is known of them."""
    roots = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    files = sources.find(roots, exclude=exclude)
    if exclude:
        every = len(sources.find(roots))
        work.note(f"{every - len(files)} of {every} clips are left out, as --exclude says")
    book = facts.book(files, roots, rules=clips, common=common)
    for line in book.notes:
        work.note(line)
    return [file for file in files if file not in book.excluded], book


def _wanted(skeleton: PathLike | Skeleton | None, book: facts.Book) -> Clip | Skeleton | None:
    if skeleton is None or isinstance(skeleton, Skeleton):
        return skeleton
    if str(skeleton) in skeletons.BUILT_IN:
        return skeletons.built_in(str(skeleton))
    return facts.read(skeleton, book.of(Path(skeleton)))


def _ground(
    clips: list[Clip],
    bodies: Sequence[Anatomy | None],
    target: skeletons.Target | None,
    fps: float,
    work: Work,
) -> list[Clip]:
    """Clips at the database's rate, on one skeleton, under a ground root; empties the list given."""

    def ground(i: int) -> Clip:
        clip, clips[i] = clips[i], None  # type: ignore[call-overload]  # two whole copies need not fit
        clip = resample.resample(clip, fps)  # first, so that planted feet stand still in between frames, too
        return root.ground(clip if target is None else target.take(clip, bodies[i]))

    return list(work.map(ground, range(len(clips)), label="prepare"))


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


def _names(pieces: Sequence[Piece]) -> list[tuple[str, str]]:
    """Each piece's name and its file's: the same, unless the file was cut into several.

    Names that occur twice are told apart by the files' folders, or else numbered.
    """
    clips = {piece.path: piece.clip for piece in pieces}
    names = [clip.name for clip in clips.values()]
    folders = [sources.folders_of(path) for path in clips]
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
    of_file = dict(zip(clips, names, strict=True))
    count = Counter(piece.path for piece in pieces)
    return [
        (f"{of_file[p.path]}@{p.start}-{p.stop}" if count[p.path] > 1 else of_file[p.path], of_file[p.path])
        for p in pieces
    ]


def _folder_rules(pieces: Sequence[Piece], names: Sequence[tuple[str, str]]) -> list[tagging.Rule]:
    pairs = [(p.path.resolve().parent.name, file) for p, (_, file) in zip(pieces, names, strict=True)]
    return [tagging.Rule(folder, glob.escape(name)) for folder, name in dict.fromkeys(pairs) if folder]


def _note_unmatchable(clips: Sequence[Clip], names: Sequence[str], fps: float, work: Work) -> None:
    """Searches skip the end of every range, so clips no longer than that are never found."""
    limit = round(Settings().ignore_end * fps)
    short = [name for name, clip in zip(names, clips, strict=True) if len(clip) <= limit]
    if short:
        work.note(
            f"{len(short)} of {len(names)} clips have {limit} frames or fewer (such as {short[0]}): "
            "a search with the default settings never finds them"
        )
