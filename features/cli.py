"""``python -m features``: look at feature schemas, label motion, fit terrain to it."""

from __future__ import annotations

from pathlib import Path

import click

from motion import config, console, files

from . import presets
from .label_cli import label
from .terrain_cli import heightmap, terrain


@console.group("features", "What a frame looks like to a search or a network: schemas, labels, terrain.")
def main() -> None:
    pass


main.add_command(label)
main.add_command(terrain)
main.add_command(heightmap)


@main.command(
    epilog="Example: python -m features schema lmm27 -o my.toml, then change my.toml "
    "and give it to: python -m mm build --schema my.toml"
)
@click.argument("name")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write to this file instead of printing.",
)
@console.json_option
def schema(name: str, output: Path | None, as_json: bool) -> None:
    """Print a schema as TOML, with its columns. NAME is a ready-made schema or a TOML file."""
    found = presets.load(name)
    if output is not None:
        files.check_output(output, inputs=[None if name in presets.names() else name])
        found.save(output)
    elif as_json:
        facts = {"size": found.size, "euclidean": found.euclidean, "fingerprint": found.fingerprint}
        console.print_json({**found.to_dict(), "columns": found.columns, "roles": found.roles(), **facts})
    else:
        click.echo(config.dumps(found.to_dict()))
        click.echo(f"# {found.size} columns")
        for feature in found.features:
            click.echo(f"# {feature.name}: {', '.join(feature.column_names())}")


@main.command("list", epilog="Example: python -m features list")
@console.json_option
def list_(as_json: bool) -> None:
    """List the ready-made schemas."""
    rows = [
        {"schema": name, "columns": presets.get(name).size, "features": len(presets.get(name).features)}
        for name in presets.names()
    ]
    if as_json:
        console.print_json(rows)
    else:
        console.print_table(rows)
