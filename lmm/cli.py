"""``python -m lmm``: train networks that drive characters, judge, exchange and run them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from motion import console
from motion.errors import UserError

from .evaluation.cli import evaluate
from .exchange_cli import convert, export, import_
from .run import run, settings_
from .training import mann_settings, pfnn_settings, settings
from .training.locomotion_settings import LocomotionTraining
from .training.mann_settings import MannTraining
from .training.pfnn_settings import CONFIGURATIONS, PhaseTraining
from .training.settings import PRESETS, RECIPES, Settings

if TYPE_CHECKING:
    from .locomotion.grounds import Terrain
    from .models import AnyModel

MODELS = ("lmm", "pfnn", "mann")


@console.group(
    "lmm",
    "Learned Motion Matching, PFNN and MANN: train them from a motion database, then evaluate and run them. "
    "A trained model called dancecard ships with the program, so you can begin with `run`.",
)
def main() -> None:
    pass


main.epilog = "Example: python -m lmm run dancecard --course thesis -o lap.bvh"


@main.command(epilog="Example: python -m lmm train walk.mmdb -o walk.lmm --preset quick")
@click.argument("db", type=click.Path())
@click.option("-o", "--output", required=True, type=click.Path(), metavar="MODEL", help="Model to write.")
@click.option(
    "--model",
    "what",
    type=click.Choice(MODELS),
    default="lmm",
    show_default=True,
    help="Learned Motion Matching, a phase-functioned or a mode-adaptive network.",
)
@click.option(
    "--preset",
    type=click.Choice(PRESETS),
    default="full",
    show_default=True,
    help="How long to train. smoke: seconds, only to see that everything works; quick: less than half an "
    "hour on two cores; full: three times as long as quick, and hours with --recipe reference.",
)
@click.option(
    "--recipe",
    type=click.Choice(RECIPES),
    default="ours",
    show_default=True,
    help="How to train. ours: faster; reference: as published.",
)
@click.option(
    "--configuration",
    type=click.Choice(CONFIGURATIONS),
    help="For --model pfnn. holden: as published; holden-xl: one more layer; holden-xt: trained twice as "
    "long; ava: as holden, named so in `bench thesis` where `mm enlarge` made the rig large.  "
    "[default: holden]",
)
@click.option(
    "--experts",
    type=click.IntRange(1, 64),
    help="For --model mann: number of expert networks; 4 and 8 are published.  [default: 4]",
)
@click.option(
    "--labels",
    type=click.Path(),
    metavar="FOLDER",
    help="For --model pfnn and mann: read foot contacts, phase and gaits from NAME.labels.csv in FOLDER "
    "instead of finding them anew, so that you can correct them by hand.",
)
@click.option(
    "--terrain",
    multiple=True,
    metavar="KIND|FILE",
    help="For --model pfnn: train on uneven ground as well: hills, slopes, steps, mixed, or the file of a "
    "heightmap.  [repeatable]",
)
@click.option(
    "--terrain-spacing",
    type=console.SIZE,
    metavar="M",
    help="Metres between neighbouring numbers of that heightmap.  [default: 0.0394, as in published ones]",
)
@click.option(
    "--grounds",
    type=click.IntRange(1, 100),
    help="How many grounds --terrain fits to each stretch of motion.  [default: 10]",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    help="Random seed: which clips are held out, first weights, batches.  [default: 0]",
)
@click.option("--resume", is_flag=True, help="Continue a training that was stopped.")
@click.option(
    "--config",
    type=click.Path(),
    metavar="FILE",
    help="TOML file with settings that replace some of the preset's.",
)
@click.option(
    "--held-out",
    type=console.Number(0, 0.9),
    metavar="SHARE",
    help="Share of the data (whole clips) that is not trained on but used to measure errors.  [default: 0.1]",
)
@click.option("--device", type=click.Choice(("cpu", "cuda")), help="Where to train.  [default: cpu]")
@click.option("--threads", type=click.IntRange(1, 1024), help="Number of CPU threads.  [default: torch's]")
@click.option(
    "--tensorboard",
    type=click.Path(),
    metavar="FOLDER",
    help="Also write logs for TensorBoard into this folder.",
)
@console.json_option
def train(
    db: str,
    output: str,
    what: str,
    preset: str,
    recipe: str,
    configuration: str | None,
    experts: int | None,
    labels: str | None,
    terrain: tuple[str, ...],
    terrain_spacing: float | None,
    grounds: int | None,
    resume: bool,
    config: str | None,
    tensorboard: str | None,
    as_json: bool,
    **chosen: Any,
) -> None:
    """Train a model from a database that `python -m mm build` wrote.

    With --model lmm four parts are trained one after another: the compressor with the decompressor, the
    stepper, the projector, and then the projector once more on what the running networks really ask it. With
    pfnn or mann it is one network. A phase-functioned network (pfnn) needs clips that walk; clips that do not
    are left out and named. A mode-adaptive network (mann) takes characters with two feet or four.

    MODEL.jsonl beside the model logs losses and errors. Ctrl-C, a crash or a power cut loses a minute at
    most: give the same command again with --resume. It comes to exactly the same model as a training that
    was never stopped. Until the model is written its state is kept in MODEL.checkpoint.

    With --terrain a phase-functioned network learns to walk on uneven ground. Patches of terrain are fitted
    under each two seconds of motion so that they meet the feet; `run --heights` then shows the network the
    ground ahead. It can only learn what the clips show: from clips that step up and down it learns to step up
    and down, from clips on level ground only to ignore the ground beside its feet.

    Training needs about 3 kB of memory for each frame of a skeleton of 23 joints (7 GB for ten hours at
    60 Hz), and as much on the GPU where there is one. Fitting terrain takes about a minute for half an hour
    of motion.

    \b
    An example of a file for --config; what was set is stored in the model:
      latent = 24
      [stepper]
      batch = 64
      iterations = 20000

    `python -m lmm info MODEL --json` prints all settings of a model. Settings of a phase-functioned network
    are in the table [pfnn], those of a mode-adaptive one in [mann]. The stepper's window counts frames at 60
    Hz whatever the rate of the data; all other lengths count frames of the data.
    """
    from motion import files

    from . import models
    from .training import checkpoint, log

    asked = _settings(what, recipe, preset, configuration, experts, config)
    options: dict[str, Any] = {"resume": resume, "tensorboard": tensorboard}
    if labels is not None:
        if what == "lmm":
            raise click.UsageError("--labels are for phases and gaits: give --model pfnn or mann too")
        options["labels"] = labels
    if what != "pfnn" and terrain:
        raise click.UsageError("--terrain is for networks that see the ground: give --model pfnn too")
    if not terrain and (terrain_spacing is not None or grounds is not None):
        name = "--grounds" if terrain_spacing is None else "--terrain-spacing"
        raise click.UsageError(f"{name} is about uneven ground: give --terrain too")
    if terrain:
        options["terrain"] = _terrain(terrain, terrain_spacing, grounds)
    asked = replace(asked, **{name: value for name, value in chosen.items() if value is not None})
    inputs = [db, config, *(name for name in terrain if files.kind(name) == "file")]
    for path in (output, log.path_of(output), checkpoint.path_of(output)):
        files.check_output(path, inputs=inputs)
    model = _train(db, output, asked, **options)
    facts = models.describe(model, output) | {
        "log": str(log.path_of(output)),
        "minutes": _minutes(output),
    }
    if as_json:
        console.print_json(facts)
    else:
        from .summary import show_errors

        size = facts["file_bytes"] / 1e6
        minutes, parameters = facts["minutes"], facts["parameters"]
        print(f"{output}: {parameters:,} parameters, {size:.1f} MB, trained in {minutes:.1f} minutes")
        show_errors(facts["errors"])


def _settings(
    what: str, recipe: str, preset: str, configuration: str | None, experts: int | None, config: str | None
) -> Settings | PhaseTraining | MannTraining:
    """What a training is told, but for what stands on the command line."""
    if configuration is not None and what != "pfnn":
        raise click.UsageError("--configuration is of phase-functioned networks: give --model pfnn too")
    if experts is not None and what != "mann":
        raise click.UsageError("--experts are of mode-adaptive networks: give --model mann too")
    base: Settings | PhaseTraining | MannTraining
    if what == "pfnn":
        base = pfnn_settings.preset(recipe, preset, configuration or CONFIGURATIONS[0])
    elif what == "mann":
        base = mann_settings.preset(recipe, preset)
    else:
        base = settings.preset(recipe, preset)
    asked = settings.load(config, base) if config else base
    if isinstance(asked, MannTraining) and experts is not None:
        return replace(asked, mann=replace(asked.mann, experts=experts))
    return asked


def _terrain(names: tuple[str, ...], spacing: float | None, count: int | None) -> Terrain:
    """Terrain to train on, of kinds and of files."""
    from features.terrain import SPACING
    from features.terrain_fit import COUNT

    from .locomotion.grounds import Terrain

    return Terrain.of(names, spacing=spacing or SPACING, count=count or COUNT)


@console.needs("train", "torch")
def _train(db: str, output: str, asked: Settings | LocomotionTraining, **options: Any) -> AnyModel:
    from mm.database import Database

    database = Database.load(db)
    if isinstance(asked, LocomotionTraining):
        from .training import train_locomotion

        return train_locomotion.train(database, output, asked, **options)
    from .training import train

    return train.train(database, output, asked, **options)


def _minutes(output: str) -> float:
    """Of training, as the log has it."""
    from .training import log

    return round(log.read(log.path_of(output))[-1]["seconds"] / 60, 2)


@main.command(epilog="Example: python -m lmm info walk.lmm --json")
@click.argument("model", type=click.Path())
@console.json_option
def info(model: str, as_json: bool) -> None:
    """Describe a model: what it is, how and from what it was trained, and how large its errors are.

    MODEL is a file that `train` wrote, or dancecard, which ships with the program. --json adds all settings
    of the training.
    """
    from . import models

    loaded = models.load(model)
    facts = models.describe(loaded, model)
    if as_json:
        console.print_json(facts)
    else:
        models.show(facts, loaded)


@main.command(epilog="Example: python -m lmm curves ours.lmm.jsonl reference.lmm.jsonl -o curves.png")
@click.argument("logs", nargs=-1, required=True, type=click.Path(), metavar="LOG...")
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(),
    metavar="PICTURE",
    help="Picture to write, .png or .svg.",
)
@click.option(
    "--names", metavar="A,B", help="Names of the logs in the picture.  [default: their files' names]"
)
@console.json_option
def curves(logs: tuple[str, ...], output: str, names: str | None, as_json: bool) -> None:
    """Plot error against minutes of training, for training clips and held-out clips.

    LOG is the file MODEL.jsonl that `train` writes beside a model. Several logs are drawn into one picture
    with a panel for each stage, and each is compared with the last one: how much sooner does it reach the
    error that the last one ends with?
    """
    from dataclasses import asdict

    from .training import curves as drawing
    from .training import log

    called = names.split(",") if names else [Path(one).name.removesuffix(".jsonl") for one in logs]
    if len(called) != len(logs):
        raise UserError(f"{len(called)} names of {len(logs)} logs", remedy="give a name a log: --names A,B")
    drawing.check_output(output, inputs=logs)
    drawing.save(output, logs, called)
    races = drawing.races([log.read(one) for one in logs], called)
    if as_json:
        console.print_json({"output": output, "races": [asdict(race) for race in races]})
        return
    for line in drawing.told(races):
        print(line)
    print(f"wrote {output}")


# Commands of other modules.
main.add_command(evaluate)
main.add_command(export)
main.add_command(import_)
main.add_command(convert)
main.add_command(run)
main.add_command(settings_)
