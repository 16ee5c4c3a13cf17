"""``python -m motion fetch``: list the registry, show a set's licence, bring the set."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .. import console
from ..errors import UserError

if TYPE_CHECKING:
    from .fetch import Result
    from .registry import DataSet, Registry


@click.command(
    epilog="\b\nExamples: python -m motion fetch\n"
    "          python -m motion fetch cmu --subject 16 --subject 35 --yes",
)
@click.argument("name", required=False)
@click.option(
    "--list", "as_list", is_flag=True, help="List the sets, as without NAME; of NAME, all about it."
)
@click.option("-o", "--output", type=click.Path(), metavar="FOLDER", help="[default: data/NAME]")
@click.option(
    "--subject", "--part", "parts", multiple=True, metavar="PART", help="Only this subject.  [repeatable]"
)
@click.option("-y", "--yes", is_flag=True, help="Accept the licence without being asked.")
@click.option(
    "--from", "elsewhere", type=click.Path(), metavar="FOLDER", help="Take files downloaded by other means."
)
@click.option("--verify", is_flag=True, help="Read all that is there and compare its checksums.")
@click.option("--registry", type=click.Path(), metavar="FILE", help="TOML file with sets of your own.")
@click.option("--timeout", type=console.SECONDS, default=30.0, show_default=True, help="Seconds of silence.")
@console.json_option
def fetch(
    name: str | None,
    as_list: bool,
    output: str | None,
    parts: tuple[str, ...],
    yes: bool,
    elsewhere: str | None,
    verify: bool,
    registry: str | None,
    timeout: float,
    as_json: bool,
) -> None:
    """Fetch the public data set NAME; without NAME, list what there is.

    The licence is printed first and accepted once: asked for on a terminal, with --yes elsewhere. What is
    there and unchanged is not downloaded again; what was cut is continued. The folder's fetched.json says
    what came from where, with checksums. Proxies are taken from https_proxy and http_proxy.
    """
    from .. import files
    from . import fetch as fetching
    from . import registry as registries
    from .download import AGAIN, Patience

    known = registries.load(registry)
    if name is None:
        if parts or output or elsewhere or verify:
            raise click.UsageError("name the set to fetch")
        _list(known, as_json)
        return
    chosen = known.find(name)
    if as_list:
        _show(chosen, as_json)
        return
    for line in _terms(chosen):
        click.echo(line, err=True)
    if elsewhere is not None and files.kind(elsewhere) != "folder":
        raise UserError("no such folder", path=elsewhere, remedy="give the folder of the downloaded files")
    folder = Path(output) if output is not None else Path("data") / chosen.name
    try:
        result = fetching.fetch(
            chosen,
            folder,
            parts=parts,
            accept=lambda: yes or _asked(),
            elsewhere=None if elsewhere is None else Path(elsewhere),
            thorough=verify,
            patience=Patience(timeout=timeout),
        )
    except KeyboardInterrupt:
        click.echo(AGAIN, err=True)
        raise
    if as_json:
        console.print_json(_plain(chosen, result))
        return
    for line in _told(chosen, result):
        click.echo(line, err=True)


def _list(known: Registry, as_json: bool) -> None:
    from .meter import amount

    if as_json:
        console.print_json([_row(one) for one in known.sets])
        return
    console.print_table(
        [
            {"name": one.name, "licence": one.licence.name, "size": amount(one.size), "holds": one.holds}
            for one in known.sets
        ]
    )


def _row(one: DataSet) -> dict[str, Any]:
    from ..config import to_dict

    row = {"size": one.size, **to_dict(one)}
    if one.series is not None:
        row["series"]["parts"] = list(one.series.takes)
    return row


def _show(one: DataSet, as_json: bool) -> None:
    from .meter import amount

    if as_json:
        console.print_json(_row(one))
        return
    for line in (*_terms(one), f"size: {amount(one.size)}", f"holds: {one.holds}"):
        click.echo(line)
    notes = one.notes
    rate = f"{notes.fps:g} frames a second" if notes.fps else ""
    for about, text in (("joints", notes.joints), ("unit", notes.unit), ("rate", rate), ("up", notes.up)):
        if text:
            click.echo(f"{about}: {text}")
    for trap in notes.traps:
        click.echo(f"note: {trap}")
    for file in one.files:
        checksum = "sha256" if file.sha256 else "md5" if file.md5 else "no checksum published"
        click.echo(f"file: {file.address} ({amount(file.size)}, {checksum})")
    if one.series is not None:
        click.echo(f"{one.series.part_name}s: {one.series.summary()}  [default: {one.series.default}]")
    if one.verified:
        click.echo(f"checked: {one.verified}")


def _terms(one: DataSet) -> list[str]:
    return [
        f"{one.title} ({one.homepage})",
        f"licence: {one.licence.name}: {one.licence.allows}",
        f"text of the licence: {one.licence.address}",
        *([f"credit: {one.credit}"] if one.credit else []),
    ]


def _asked() -> bool:
    if not console.is_terminal(sys.stdin) or not console.is_terminal(sys.stderr):
        raise UserError("no terminal to ask on whether you accept the licence", remedy="accept it with --yes")
    return click.confirm("Do you accept the licence?", err=True)


def _told(one: DataSet, result: Result) -> list[str]:
    """What happened, in a few lines."""
    new, old = len(result.downloaded), len(result.present)
    lines = [f"{result.folder}: {new} downloaded, {old} already there"]
    if result.missing:
        some = ", ".join(address.rpartition("/")[2] for address in result.missing[:8])
        more = f" and {len(result.missing) - 8} more" if len(result.missing) > 8 else ""
        lines.append(f"not on the server: {some}{more}")
    if result.unverified:
        what = "this file" if len(result.unverified) == 1 else f"{len(result.unverified)} of these files"
        lines.append(
            f"not verified: nobody publishes a checksum of {what}; what came first is recorded in "
            "fetched.json, and compared from now on"
        )
    if new + old > len(result.unverified):
        lines.append("verified: as published" + (", the rest" if result.unverified else ""))
    options = f" {one.options}" if one.options else ""
    return [*lines, f"next: python -m motion info {result.folder}{options}"]


def _plain(one: DataSet, result: Result) -> dict[str, Any]:
    return {
        "name": one.name,
        "folder": result.folder,
        "downloaded": result.downloaded,
        "present": result.present,
        "missing": result.missing,
        "unverified": result.unverified,
        "options": one.options,
    }
