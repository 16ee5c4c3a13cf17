"""``python -m mm compress``: make a database small, and say what that costs."""

from __future__ import annotations

import click

from motion import console

from .codec import FEATURES


@click.command(
    epilog="Example: python -m mm compress walk.mmdb -o small.mmdb --codec quantised-11 --features 8bit"
)
@click.argument("db", type=click.Path())
@click.option(
    "-o", "--output", required=True, type=click.Path(), metavar="SMALL", help="Compressed database to write."
)
@click.option(
    "--codec",
    "codecs",
    multiple=True,
    default=["quantised-11"],
    show_default=True,
    metavar="NAME",
    help="How poses are stored, see above.  [repeatable]",
)
@click.option(
    "--features",
    type=click.Choice(FEATURES),
    default="float32",
    show_default=True,
    help="How features are stored.",
)
@console.json_option
def compress(db: str, output: str, codecs: tuple[str, ...], features: str, as_json: bool) -> None:
    """Make a database small, and measure what that costs.

    SMALL goes to `run` and `info`; poses are decoded when they are played. Several codecs are chained.

    \b
      float16        half floats
      recomputed     velocities are differences of the poses decoded
      quantised-11   rotations by their three smallest components, 11 bits each (6 to 18); translations that
                     vary of 16 bits, the others once; velocities recomputed
      keyframes-0.5  so few frames that of those between no joint, nor what turns with it within
                     10 cm, is off by more than 0.5 cm; velocities recomputed

    Features: 8bit rounds every column to 256 values; pq (product quantisation) takes a byte for three
    columns. The search runs on what is decoded of them; or with `run --index coded`, which takes longer, on 8
    bits as they are stored.
    """
    from motion import files

    from ..database import Database
    from . import errors, summary
    from .codec import parse
    from .compressed import compress as compressed

    codec = parse(codecs, features=features)
    files.check_output(output, inputs=[db])
    database = Database.load(db)
    small = compressed(database, codec)
    small.errors = errors.measure(database, small)
    small.save(output)
    facts = summary.describe(small, output)
    if as_json:
        console.print_json(facts)
    else:
        summary.show(facts)
