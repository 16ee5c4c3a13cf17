"""One file over HTTP: resumed, retried, checked, and in its place only when it is whole.

What has arrived stands in ``NAME.part``, and what identifies the file on the server (its ETag or date, RFC
9110 8.8) in ``NAME.part.json``, so that a later attempt, or a later run, asks for the rest alone (Range with
If-Range, RFC 9110 13.1.5 and 14.2).
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import http.client
import json
import os
import re
import shutil
import socket
import ssl
import time
import urllib.error
import urllib.parse
import urllib.request
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

from ..errors import UserError
from . import meter

CHUNK = 1 << 18
SPARE = 64 << 20  # bytes of disk to leave free
PASSING = {408, 425, 429, 500, 502, 503, 504}  # answers of a server that may do better later
AGAIN = "what arrived is kept: give the same command again to go on from there"


class Missing(UserError):
    """The server has no such file."""


@dataclass(frozen=True)
class Patience:
    """How long to wait for a server: seconds without a byte, attempts without progress, first pause."""

    timeout: float = 30.0
    attempts: int = 5
    pause: float = 1.0


@dataclass(frozen=True)
class Arrived:
    """A whole file: its size, checksum, and the kind of published checksum it was compared with, if any."""

    size: int
    sha256: str
    published: str | None


@dataclass
class _Part:
    """What is known of a download under way."""

    address: str
    validator: str | None = None
    total: int | None = None


class _Cut(Exception):
    """The connection failed in a way that another attempt may mend."""

    def __init__(self, what: str, wait: float | None = None) -> None:
        super().__init__(what)
        self.wait = wait


class _Changed(Exception):
    """What is there cannot be continued."""


class _Redirects(urllib.request.HTTPRedirectHandler):
    """Follow to HTTP addresses only, and never from a protected one to an open one."""

    def redirect_request(self, req: Any, fp: Any, code: int, msg: str, headers: Any, newurl: str) -> Any:
        old, new = (urllib.parse.urlsplit(address).scheme for address in (req.full_url, newurl))
        if new not in ("http", "https") or (old == "https" and new == "http"):
            fp.close()
            raise UserError(
                f"{req.full_url} redirects to {newurl}, which is not protected",
                remedy="download it by hand if you trust it, and give its folder with --from",
            )
        return super().redirect_request(req, fp, code, msg, headers, newurl)


def download(
    address: str,
    target: Path,
    *,
    size: int | None = None,
    sha256: str | None = None,
    md5: str | None = None,
    patience: Patience | None = None,
    label: str = "",
) -> Arrived:
    """The file at an address, whole and checked, at target (replaced in one step).

    size, sha256 and md5 are what is published of it. Proxies are taken from the environment, as urllib does.
    Whatever goes wrong is a UserError that says what to do; a cut download can be continued by calling again.
    Progress is shown under the label, if there is one.
    """
    patience = patience or Patience()
    part, about = target.with_name(target.name + ".part"), target.with_name(target.name + ".part.json")
    attempts, before, restarted = 0, -1, False
    while True:
        try:
            checked = bool(sha256 or md5)
            resumed = _attempt(address, part, about, size, checked, patience, label)
        except _Changed as why:
            # Once is a file that was replaced on the server; again and again is no file to be had.
            _forget(part, about)
            if restarted:
                raise UserError(f"{address}: {why}", remedy="try again later") from None
            restarted = True
            continue
        except _Cut as why:
            have = _length(part)
            attempts, before = (1 if have > before else attempts + 1), max(have, before)
            if attempts >= patience.attempts:
                raise UserError(f"{address}: {why} ({attempts} attempts)", remedy=AGAIN) from None
            time.sleep(min(why.wait if why.wait is not None else patience.pause * 2 ** (attempts - 1), 60))
            continue
        found = digests(part, ("sha256", "md5") if md5 else ("sha256",))
        published = "sha256" if sha256 else "md5" if md5 else None
        for kind, expected in (("sha256", sha256), ("md5", md5)):
            if expected is None or found[kind] == expected:
                continue
            _forget(part, about)
            if resumed and not restarted:
                restarted = True  # two halves of different files, perhaps
                break
            raise UserError(
                f"{address}: its {kind} is {found[kind]}, published is {expected}; it was thrown away",
                remedy="try again later, or look at the set's homepage whether it has been replaced",
            )
        else:
            arrived = Arrived(_length(part), found["sha256"], published)
            os.replace(part, target)
            about.unlink(missing_ok=True)
            return arrived


def digests(path: Path, kinds: tuple[str, ...] = ("sha256",)) -> dict[str, str]:
    """Checksums of a file, by kind, in hexadecimal digits."""
    hashes = {kind: hashlib.new(kind, usedforsecurity=False) for kind in kinds}
    with open(path, "rb") as stream:
        while block := stream.read(1 << 20):
            for one in hashes.values():
                one.update(block)
    return {kind: one.hexdigest() for kind, one in hashes.items()}


def check_room(folder: Path, needed: int) -> None:
    """A UserError unless a folder's disk has room for a number of bytes."""
    free = shutil.disk_usage(folder).free
    if needed + SPARE > free:
        raise UserError(
            f"the disk has {meter.amount(free)} free, {meter.amount(needed + SPARE)} are needed",
            path=folder,
            remedy="make room, or choose a folder on another disk with -o",
        )


def _attempt(
    address: str, part: Path, about: Path, size: int | None, checked: bool, patience: Patience, label: str
) -> bool:
    """Bring part to its full length; whether something was there already.

    What neither the server nor a checksum identifies is not continued: it might be the half of another file.
    """
    known = _read(about, address)
    if known is None or (known.validator is None and not checked):
        _forget(part, about)
        known = _Part(address)
    have = _length(part)
    if have and known.total == have:
        return True
    with contextlib.closing(_open(address, have, known.validator, patience)) as answer:
        start = _accept(answer, have, known, size)
        about.write_text(json.dumps(asdict(known)))
        check_room(part.parent, (known.total or 0) - start)
        try:
            with open(part, "r+b" if start else "wb") as stream:
                stream.seek(start)
                stream.truncate()
                _copy(answer, stream, start, known.total, label, part.parent)
                os.fsync(stream.fileno())
        except OSError as error:
            if error.errno in (errno.ENOSPC, errno.EDQUOT):
                remedy = f"make room; {AGAIN}"
                raise UserError("the disk is full", path=part.parent, remedy=remedy) from error
            raise
    have = _length(part)
    if known.total is not None and have < known.total:
        raise _Cut(f"the connection was cut after {have:,} of {known.total:,} bytes")
    if size is not None and have != size:
        _forget(part, about)
        raise UserError(f"{address}: {have:,} bytes arrived, published are {size:,}", remedy=_REPLACED)
    return start > 0


_REPLACED = "look at the set's homepage whether the file has been replaced"


def _open(address: str, have: int, validator: str | None, patience: Patience) -> Any:
    """The server's answer to a request for the bytes from have on."""
    request = urllib.request.Request(address, headers={"User-Agent": "motion-matching", "Accept": "*/*"})
    if have:
        request.add_header("Range", f"bytes={have}-")
        if validator:
            request.add_header("If-Range", validator)
    opener = urllib.request.build_opener(_Redirects)
    host = _reached(address)
    try:
        return opener.open(request, timeout=patience.timeout)
    except urllib.error.HTTPError as error:
        error.close()
        if error.code == 416:
            raise _Changed("the server has another length than before") from None
        if error.code in PASSING:
            raise _Cut(f"the server answers {error.code} {error.reason}", _wait(error.headers)) from None
        what = f"{address}: the server answers {error.code} {error.reason}"
        if error.code in (404, 410):
            remedy = "it has moved: look at the set's homepage, and give its new address with --registry"
            raise Missing(what, remedy=remedy) from None
        raise UserError(what, remedy="look at the set's homepage whether it asks for more") from None
    except urllib.error.URLError as error:
        why = error.reason
        if isinstance(why, ssl.SSLCertVerificationError):
            raise UserError(
                f"{host}: its certificate is not trusted: {why.verify_message}",
                remedy="check this machine's clock and certificates (SSL_CERT_FILE names a file of them), "
                "or download by hand and give the folder with --from",
            ) from None
        if isinstance(why, socket.gaierror):
            raise UserError(
                f"{host}: no such host, or no network: {why.strerror}",
                remedy="connect, name a proxy in https_proxy, or download "
                f"{address} elsewhere and give its folder with --from",
            ) from None
        if isinstance(why, ConnectionRefusedError):
            remedy = "try again later, or correct the proxy in https_proxy"
            raise UserError(f"{host}: the connection was refused", remedy=remedy) from None
        if isinstance(why, OSError) and why.errno in (errno.ENETUNREACH, errno.EHOSTUNREACH):
            remedy = f"connect, or download {address} elsewhere and give its folder with --from"
            raise UserError(f"{host}: {why.strerror}", remedy=remedy) from None
        if "Tunnel connection failed" in str(why):
            remedy = f"correct https_proxy, or download {address} elsewhere and give its folder with --from"
            raise UserError(
                f"{host}: the proxy refuses: {str(why).partition(': ')[2]}", remedy=remedy
            ) from None
        raise _Cut(_said(why)) from None
    except (TimeoutError, ConnectionError, http.client.HTTPException) as error:
        raise _Cut(_said(error)) from None
    except ValueError as error:  # a redirect to no address
        raise UserError(f"{address}: {error}", remedy=_REPLACED) from None


def _reached(address: str) -> str:
    """The host of an address for a message, with the proxy that it is reached by."""
    parts = urllib.parse.urlsplit(address)
    proxy = urllib.request.getproxies().get(parts.scheme)
    if proxy is None or urllib.request.proxy_bypass(parts.netloc):
        return str(parts.hostname)
    return f"{parts.hostname} by the proxy {proxy.rpartition('@')[2]}"


def _accept(answer: Any, have: int, known: _Part, size: int | None) -> int:
    """Where in the file the answer's body starts; notes length and validator. Another part is _Changed."""
    headers, start = answer.headers, 0
    if headers.get("Content-Encoding", "identity") != "identity":
        raise UserError(
            f"{known.address}: the server sends it encoded", remedy="download it by hand (--from)"
        )
    length = headers.get("Content-Length", "")
    total = int(length) if re.fullmatch(r"\d{1,18}", length) else None
    tag = headers.get("ETag", "")
    validator = tag if tag.startswith('"') else headers.get("Last-Modified")
    if answer.status == 206:
        match = re.fullmatch(r"bytes (\d+)-\d+/(\d+|\*)", headers.get("Content-Range", ""))
        if not have or match is None or int(match[1]) != have:
            raise _Changed("the server answers with another part than was asked for")
        start, total = have, None if match[2] == "*" else int(match[2])
        replaced = known.validator is not None and validator is not None and known.validator != validator
        if replaced or (None not in (known.total, total) and known.total != total):
            raise _Changed("the file changes on the server while it is read")
    if size is not None and total is not None and size != total:
        what = f"{known.address}: the server announces {total:,} bytes, published are {size:,}"
        raise UserError(what, remedy=_REPLACED)
    known.total, known.validator = (size if total is None else total), validator
    return start


def _copy(answer: Any, stream: IO[bytes], start: int, total: int | None, label: str, folder: Path) -> None:
    """The answer's body into the stream; no more than is expected, nor than the folder's disk takes."""
    done = looked = start
    with meter.meter(label, total, start) as report:
        while True:
            try:
                block = answer.read1(CHUNK)
            except http.client.IncompleteRead:
                raise _Cut(f"the connection was cut after {done:,} bytes") from None
            except (TimeoutError, ConnectionError, ssl.SSLError) as error:
                raise _Cut(f"{_said(error)} after {done:,} bytes") from None
            if not block:
                return
            stream.write(block)
            done += len(block)
            report(done)
            if total is not None and done > total:
                return
            if done - looked >= SPARE:  # of what announces no length the end cannot be foreseen
                looked = done
                check_room(folder, 0)


def _said(error: BaseException | str) -> str:
    if isinstance(error, TimeoutError):
        return "the server does not answer"
    if isinstance(error, http.client.RemoteDisconnected):
        return "the server closed the connection without an answer"
    return f"the connection failed: {getattr(error, 'strerror', None) or error}"


def _wait(headers: Any) -> float | None:
    text = headers.get("Retry-After", "") if headers else ""
    return float(text) if re.fullmatch(r"\d{1,6}", text) else None


def _read(about: Path, address: str) -> _Part | None:
    """What is known of the part beside; None if it is of another file, or cannot be told."""
    try:
        known = _Part(**json.loads(about.read_text()))
    except (OSError, ValueError, TypeError):
        return None
    return known if known.address == address else None


def _forget(part: Path, about: Path) -> None:
    part.unlink(missing_ok=True)
    about.unlink(missing_ok=True)


def _length(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0
