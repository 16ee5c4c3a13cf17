"""Commands that exchange models: with the public reference, as ONNX, with other weights."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from motion import console
from motion.errors import UserError

from .locomotion.model import LocomotionModel

if TYPE_CHECKING:
    from mm.database import Database

    from .model import Model

FAR = 10.0  # cm that poses are off on average where networks do not know the data
SAMPLE = 2000  # frames are enough for a mean

DB = click.option("--db", type=click.Path(), metavar="DB", help="Database that the model was trained from.")


@click.command(epilog="Example: python -m lmm export walk.lmm --format onnx -o networks")
@click.argument("model", type=click.Path())
@click.option(
    "--format",
    "form",
    type=click.Choice(("reference", "onnx")),
    required=True,
    help="Format to write, see above.",
)
@click.option(
    "-o", "--output", required=True, type=click.Path(), metavar="FOLDER", help="Folder to write into."
)
@DB
def export(model: str, form: str, output: str, db: str | None) -> None:
    """Write the networks of a learned motion matching model for other programs.

    \b
    reference  decompressor.bin, stepper.bin, projector.bin as the public reference
               reads them, all float32; with --db also latent.bin, features.bin and
               database.bin
    onnx       decompressor.onnx, stepper.onnx, projector.onnx with the normalisation
               inside and weights as the model has them; their metadata says what
               their numbers mean
    """
    from mm.database import Database
    from motion import files

    from . import interchange, onnx_export
    from .model import Model

    if form == "onnx" and db:
        raise UserError("--db goes with --format reference", remedy="leave it out")
    onnx = form == "onnx"
    expected = onnx_export.outputs(output) if onnx else interchange.outputs(output, with_database=bool(db))
    for path in expected:
        files.check_output(path, inputs=[model, db])
    found = Model.load(model)
    if onnx:
        paths = onnx_export.export_directory(found, output)
    else:
        database = Database.load(db) if db else None
        if database is not None:
            found.check(database, model)
        paths = interchange.export_directory(found, output, database=database)
    for path in paths:
        print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")


@click.command(
    "import",
    epilog="\b\nExamples: python -m lmm import reference/resources --db walk.mmdb -o walk.lmm\n"
    "          python -m lmm import pfnn/network --animations pfnn/animations -o walk.pfnn",
)
@click.argument("directory", type=click.Path())
@click.option(
    "--db",
    type=click.Path(),
    metavar="DB",
    help="Database that the networks were trained from; `python -m mm import` reads the reference's.",
)
@click.option(
    "--animations",
    type=click.Path(),
    metavar="FOLDER",
    help="For a phase-functioned network: the clips that were published with it, of whose skeleton it is.",
)
@click.option("-o", "--output", required=True, type=click.Path(), metavar="MODEL", help="Model to write.")
def import_(directory: str, db: str | None, animations: str | None, output: str) -> None:
    """Turn the public reference's networks, or the published phase-functioned network, into a model.

    DIRECTORY must hold decompressor.bin, stepper.bin and projector.bin; latent.bin is used if it is there.
    Of a phase-functioned network it holds W0_000.bin and so on; give --animations in place of --db then.

    The files hold numbers only, so skeleton, features, normalisation and frame rate are taken from DB.
    Networks that were trained on another database still run, but the motion makes no sense; therefore the
    error of their poses is measured and printed.

    The latents of the database's frames go into the model: mixtures of networks and database need them.
    Without latent.bin they are what the projector answers for each frame.
    """
    from mm.database import Database
    from motion import files

    from . import interchange

    if (db is None) == (animations is None):
        raise click.UsageError("give --db, or --animations where it is a phase-functioned network")
    if animations is not None:
        from .pfnn import published

        files.check_output(output, inputs=[animations, *published.files_of(directory)])
        phased = published.model(directory, animations)
        phased.save(output)
        size = Path(output).stat().st_size / 1e6
        print(f"{output}: {phased.parameters:,} parameters, {size:.2f} MB")
        return
    binaries = [Path(directory, f"{name}.bin") for name in (*interchange.RUNTIME, "latent", "features")]
    files.check_output(output, inputs=[db, *binaries])
    model = interchange.import_directory(directory, Database.load(str(db)))
    model.save(output)
    off = model.errors["decompressor"]["all"]
    print(
        f"{output}: {model.parameters:,} parameters, {Path(output).stat().st_size / 1e6:.2f} MB; "
        f"poses of the database's frames are {off['position_cm']:.2f} cm and "
        f"{off['rotation_deg']:.2f} degrees off"
    )
    if off["position_cm"] > FAR:
        print("note: so far off, the networks are hardly of this database", file=sys.stderr)


@click.command(epilog="Example: python -m lmm convert walk.lmm -o small.lmm --weights int8 --db walk.mmdb")
@click.argument("model", type=click.Path())
@click.option("-o", "--output", required=True, type=click.Path(), metavar="MODEL2", help="Model to write.")
@click.option(
    "--weights",
    required=True,
    type=click.Choice(("float32", "float16", "int8")),
    help="Type to store weights as.",
)
@click.option(
    "--without-compressor",
    is_flag=True,
    help="Leave out what only mixtures with the database need: the compressor, or latents stored instead.",
)
@click.option(
    "--db",
    type=click.Path(),
    metavar="DB",
    help="Database that the model was trained from, to measure errors on.",
)
@console.json_option
def convert(
    model: str, output: str, weights: Any, without_compressor: bool, db: str | None, as_json: bool
) -> None:
    """Store the weights of a model in another type; tells what that saves and loses.

    int8, of learned motion matching alone, has a scale for each output of a layer. The compressor, which no
    character needs at run time, becomes float16 then.

    With --db errors of poses, in cm and degrees, are measured on training clips and on held-out clips, for
    the model before and after; of networks that a trajectory drives, those of one step. stepper_change and
    projector_change tell how much the answers of these networks change, as a share of how much they vary.
    """
    from mm.database import Database
    from motion import files

    from . import models
    from .model import Model

    files.check_output(output, inputs=[model, db])
    before = models.load(model)
    if without_compressor and not isinstance(before, Model):
        raise UserError(f"a {before.kind} has no compressor", path=model, remedy="leave out the option")
    database = Database.load(db) if db else None
    if database is not None:
        before.check(database, model)
    after, _ = models.with_weights(before, weights)
    if without_compressor and isinstance(after, Model):
        after = after.without_latents()
    after.save(output)
    rows = [_row(path, found) for path, found in ((model, before), (output, after))]
    if database is not None:
        for row, found in zip(rows, (before, after), strict=True):
            if isinstance(before, Model) and isinstance(found, Model):
                row |= _errors(before, found, database)
            elif isinstance(found, LocomotionModel):
                row |= _step_errors(found, database)
    if as_json:
        console.print_json(rows)
    else:
        console.print_table([{key.replace("_", " "): value for key, value in row.items()} for row in rows])


def _row(path: str, model: Model | LocomotionModel) -> dict[str, Any]:
    from . import pretrained

    size = pretrained.find(path).stat().st_size
    if isinstance(model, LocomotionModel):
        parts = {f"{name}_bytes": found for name, found in model.weight_bytes().items()}
        return {"model": path, "weights": model.network.weight_type, "file_bytes": size, **parts}
    return {
        "model": path,
        "weights": model.decompressor.weight_type,
        "compressor": model.compressor.weight_type if model.compressor else None,
        "file_bytes": size,
        "runtime_bytes": sum(model.memory().values()),
    }


def _step_errors(model: LocomotionModel, database: Database) -> dict[str, Any]:
    """Of one step of a network that a trajectory drives."""
    from .evaluation import frames
    from .evaluation.locomotion import truth_of

    truth = truth_of(model, database)
    found = frames.poses(truth, frames.step(truth))
    return {
        f"{part}_{name}": round(found[part][name]["mean"], 4) if part in found else None
        for part in ("training", "held_out")
        for name in ("position_cm", "rotation_deg")
    }


def _errors(before: Model, after: Model, database: Database) -> dict[str, Any]:
    """Of a model whose weights were stored otherwise."""
    from . import interchange

    if before.knows_latents:
        latents = before.latents(database)
    else:
        latents = interchange.projected_latents(before.projector, before.description, database)
    training = before.training_ranges(database)
    found: dict[str, Any] = {}
    for part, ranges in (("training", training), ("held_out", ~training)):
        off = interchange.mean_errors(after, database, latents, ranges=ranges) if ranges.any() else {}
        found |= {
            f"{part}_{name}": round(off[name], 4) if off else None for name in ("position_cm", "rotation_deg")
        }
    sample = np.unique(np.linspace(0, len(database) - 1, SAMPLE).astype(np.int64))
    inputs = {
        "stepper": np.concatenate([database.features[sample], latents[sample]], axis=1),
        "projector": interchange.own_queries(before.description, database, sample),
    }
    for name, x in inputs.items():
        truth = before.networks[name].evaluate(x)
        change = np.abs(after.networks[name].evaluate(x) - truth)
        varies = float(np.abs(truth - truth.mean(axis=0)).mean())
        found[f"{name}_change"] = round(float(change.mean()) / varies, 6) if varies > 0 else None
    return found
