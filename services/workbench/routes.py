"""Routes of the server, requests and answers (listed in ``docs/workbench-api.md``)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import APIRouter, Body, Request
from fastapi.responses import JSONResponse, Response, StreamingResponse

from lacet.daq.errors import UsageError
from lacet.services.workbench import (
    channel_maps,
    exports,
    file_changes,
    help_pages,
    study_views,
    uploads,
    user_effects,
)
from lacet.services.workbench.effect_previews import preview_body
from lacet.services.workbench.events import Events
from lacet.services.workbench.force_views import forces_png
from lacet.services.workbench.formula_views import formula_body
from lacet.services.workbench.jobs import Job, Jobs
from lacet.services.workbench.live import Live
from lacet.services.workbench.live_fit import LiveFitProcess
from lacet.services.workbench.packed_arrays import MEDIA_TYPE
from lacet.services.workbench.refusals import NotThere
from lacet.services.workbench.residual_views import against_payload, spectrum_payload, where_payload
from lacet.services.workbench.run_channels import RunChannels
from lacet.services.workbench.run_files import RunFiles, find_run, undecoded, undecoded_record
from lacet.services.workbench.session_cache import WAIT, SessionCache
from lacet.services.workbench.value_views import values_payload
from lacet.services.workspace.live_follow import TARGET

api = APIRouter(prefix="/api")
_JSON = Annotated[dict[str, Any], Body()]


@dataclass(frozen=True)
class Bench:
    """Parts of the server that the routes use; `most_upload` [bytes]."""

    cache: SessionCache
    jobs: Jobs
    events: Events
    files: RunFiles
    channels: RunChannels
    live: Live
    live_fit: LiveFitProcess
    most_upload: int


def bench(request: Request) -> Bench:
    """The parts of the server that answers a request."""
    found = request.app.state.bench
    assert isinstance(found, Bench)
    return found


# -- the study --------------------------------------------------------------------------------------------------------


@api.get("/study")
def study(request: Request) -> Any:
    """The study, its versions, the present one's diagnosis."""
    b = bench(request)
    return study_views.study_payload(b.cache, b.jobs.busy.as_data() if b.jobs.busy else None)


@api.post("/study/runs")
def choose(request: Request, body: _JSON) -> Any:
    """Choose the runs: creates the study, or refits its model."""
    return _submitted(bench(request), "choose", {key: body.get(key, []) for key in ("used", "held")})


@api.get("/runs")
def runs(request: Request, wait: bool = True) -> Any:
    """The list of runs; without `wait` at once, those that have to be read first marked."""
    b = bench(request)
    waiting = [path for path in undecoded(b.cache) if _decoding(b, path.name) is None]
    found = b.files.all() if wait else b.files.at_once(lambda: b.events.publish("study", {"changed": ["runs"]}))
    return [*found, *map(undecoded_record, waiting)]


@api.get("/runs/{name}")
def one_run(request: Request, name: str) -> Any:
    """One run with its channels."""
    return bench(request).files.one(name)


@api.get("/runs/{name}/consequences")
def consequences(request: Request, name: str) -> Any:
    """What no longer fits together when a file is replaced or removed."""
    return file_changes.consequences(bench(request).cache, name)


@api.get("/runs/{name}/map")
def channel_map(request: Request, name: str) -> Any:
    """Names of a log, and its channel map."""
    return channel_maps.map_payload(bench(request).cache, name)


@api.post("/runs/{name}/map")
def check_map(request: Request, name: str, body: _JSON, keep: bool = False) -> Any:
    """Check of a channel map, and its storage."""
    b = bench(request)
    found = channel_maps.check_map(b.cache, name, body, keep)
    if keep:
        b.events.publish("study", {"changed": ["runs"]})
    return found


@api.delete("/runs/{name}")
def remove_run(request: Request, name: str) -> Any:
    """Move a file aside."""
    b = bench(request)
    with b.cache.computing(WAIT):
        found = file_changes.remove(b.cache, name)
    b.events.publish("study", {"changed": ["runs"]})
    return found


@api.put("/runs/{filename:path}")
async def upload(request: Request, filename: str, replace: bool = False) -> Any:
    """A file from the browser."""
    b = bench(request)
    length = request.headers.get("content-length")
    announced = int(length) if length and length.isdigit() else None
    found = await uploads.take(b.cache, filename, announced, request.stream(), b.most_upload, replace)
    if found["raw"]:
        at_work = _decoding(b, found["file"])
        found["job"] = (at_work or b.jobs.submit("decode", {"file": found["file"]})).as_data()
    b.events.publish("study", {"changed": ["runs"]})
    return found


@api.get("/parameters")
def parameters(request: Request, version: int | None = None) -> Any:
    """A version's parameters."""
    return study_views.parameters_payload(bench(request).cache.study, version)


@api.get("/values")
def values(request: Request, version: int | None = None, against: int | None = None) -> Any:
    """Derived values and parameters of a version, beside those of another."""
    return values_payload(bench(request).cache.study, version, against)


@api.get("/effects")
def effects(request: Request) -> Any:
    """The catalogue with the study's own effects."""
    return user_effects.catalogue_payload(bench(request).cache)


@api.post("/effect/check")
def check_effect(request: Request, body: _JSON) -> Any:
    """Interpretation of a line."""
    return user_effects.check(bench(request).cache, *_line(body))


@api.post("/effect")
def keep_effect(request: Request, body: _JSON) -> Any:
    """Store a line."""
    b = bench(request)
    meant = body.get("parameters") or []
    if not isinstance(meant, list) or not all(isinstance(name, str) for name in meant):
        raise UsageError("parameters: a list of names")
    found = user_effects.keep(b.cache, *_line(body), meant)
    b.events.publish("study", {"changed": ["effects"]})
    return found


@api.get("/terms")
def terms(request: Request) -> Any:
    """Terms of the page in a sentence each."""
    return help_pages.terms_payload()


@api.get("/docs/{name}")
def docs(request: Request, name: str) -> Response:
    """A page of the documentation as text."""
    return Response(help_pages.doc_page(name), media_type="text/plain; charset=utf-8")


@api.get("/car")
def car(request: Request) -> Any:
    """The car in plan view."""
    found = bench(request).cache.study
    return study_views.car_payload(found.vehicle, found.rig)


# -- jobs -------------------------------------------------------------------------------------------------------------


@api.post("/jobs")
def start(request: Request, body: _JSON) -> Any:
    """Start a job."""
    b = bench(request)
    do, args = body.get("do"), body.get("args") or {}
    if do not in b.jobs.tasks:
        raise UsageError(f"there is no job '{do}': {', '.join(b.jobs.tasks)}")
    if not isinstance(args, dict):
        raise UsageError("args: values by name")
    return _submitted(b, do, args)


@api.get("/jobs")
def jobs(request: Request) -> Any:
    """Every job, without results."""
    return [job.as_data() for job in bench(request).jobs.all()]


@api.get("/jobs/{number}")
def job(request: Request, number: int) -> Any:
    """A job with its result."""
    return _job(bench(request), number).as_data(result=True)


@api.delete("/jobs/{number}")
def cancel(request: Request, number: int) -> Any:
    """Cancel a job."""
    b = bench(request)
    found = _job(b, number)
    b.jobs.cancel(found)
    return found.as_data()


@api.get("/events")
async def events(request: Request) -> StreamingResponse:
    """Stream of changes."""
    b = bench(request)

    def first() -> dict[str, Any]:
        return {"pages": b.events.listening, "jobs": [one.as_data() for one in b.jobs.open()]}

    stream = b.events.stream(first)
    return StreamingResponse(stream, media_type="text/event-stream", headers={"X-Accel-Buffering": "no"})


@api.get("/live")
def live(request: Request) -> Any:
    """Live state of the recording."""
    return bench(request).live.payload()


@api.get("/live/curves")
def live_curves(request: Request, names: str) -> Response:
    """The last seconds of channels, names separated by commas."""
    return _bytes(bench(request).live.curves(names.split(",")[:40]))


@api.post("/live/fit")
def live_fit(request: Request, body: _JSON) -> Any:
    """The present state of the live fit, which is begun to a target [%]."""
    target, b = body.get("target", TARGET), bench(request)
    if not isinstance(target, int | float):
        raise UsageError("target: a per cent")
    return b.live_fit.ask(float(target), b.cache.study.current if b.cache.exists else None)


@api.post("/live/mark")
def mark(request: Request, body: _JSON) -> Any:
    """Set a marker in the recording."""
    text = body.get("text", "")
    if not isinstance(text, str):
        raise UsageError("text: what is marked")
    return bench(request).live.mark(text)


# -- views ------------------------------------------------------------------------------------------------------------


@api.get("/compare/{version}")
def compare(request: Request, version: int) -> Any:
    """Scores of a version."""
    return bench(request).cache.compared(version).payload


@api.get("/series/{version}/{run}/{row}")
def series(request: Request, version: int, run: str, row: str) -> Response:
    """Measured and modelled row, with the contribution of each effect."""
    cache = bench(request).cache
    return _bytes(study_views.series_body(cache.compared(version), run, row, study_views.colour_places(cache.study)))


@api.get("/forces/{version}/{run}")
def forces(request: Request, version: int, run: str) -> Response:
    """Picture of a held-out run's wheel forces, estimated without dynamometers."""
    return Response(forces_png(bench(request).cache, version, run), media_type="image/png")


@api.get("/channels/{run}")
def channels(request: Request, run: str, names: str, samples: bool = False) -> Response:
    """Measured channels, names separated by commas: their overview, or all samples."""
    b = bench(request)
    body = b.channels.samples if samples else b.channels.overview
    return _bytes(body(find_run(b.cache, run), names.split(",")))


@api.get("/formula/{version}/{run}")
def formula(request: Request, version: int, run: str, text: str) -> Response:
    """A formula in the measured states along a run."""
    return _bytes(formula_body(bench(request).cache, version, run, text))


@api.get("/map/{version}")
def residual_map(request: Request, version: int) -> Any:
    """The residual map."""
    return study_views.map_payload(bench(request).cache.compared(version))


@api.get("/where/{version}")
def where(request: Request, version: int) -> Any:
    """Failure analysis of a version."""
    return where_payload(bench(request).cache, version)


@api.get("/against/{version}/{row}/{state}")
def against(request: Request, version: int, row: str, state: str) -> Any:
    """A row's residual against a state."""
    return against_payload(bench(request).cache, version, row, state)


@api.get("/spectrum/{version}/{row}")
def spectrum(request: Request, version: int, row: str) -> Any:
    """Spectrum of a row's residual."""
    return spectrum_payload(bench(request).cache, version, row)


@api.get("/preview/{version}/{effect}")
def preview(request: Request, version: int, effect: str) -> Response:
    """What one more effect does, where it does most."""
    return _bytes(preview_body(bench(request).cache, version, effect))


@api.get("/export/{name}")
def export(request: Request, name: str) -> Response:
    """An exported file."""
    makers: dict[str, Callable[[SessionCache], exports.File]] = exports.MAKERS
    if name not in makers:
        raise NotThere(f"there is no export '{name}': {', '.join(makers)}")
    file = makers[name](bench(request).cache)
    headers = {"Content-Disposition": f'attachment; filename="{file.name}"'}
    if file.policy:
        headers["Content-Security-Policy"] = file.policy
    return Response(file.body, media_type=file.kind, headers=headers)


@api.api_route("/{rest:path}", methods=["GET", "POST", "PUT", "DELETE"])
def nothing(rest: str) -> JSONResponse:
    """Every other address."""
    raise NotThere(f"there is no /api/{rest[:80]}")


def _submitted(b: Bench, do: str, args: dict[str, Any]) -> dict[str, Any]:
    made: Job = b.jobs.submit(do, args)
    return {"job": made.as_data(), "id": made.id}


def _decoding(b: Bench, file: str) -> Job | None:
    """The job that decodes a capture, waiting or running."""
    return next((j for j in b.jobs.all() if (j.do, j.args) == ("decode", {"file": file}) and not j.over), None)


def _job(b: Bench, number: int) -> Job:
    found = b.jobs.get(number)
    if found is None:
        raise NotThere(f"there is no job {number}")
    return found


def _line(body: dict[str, Any]) -> tuple[str, str]:
    name, line = body.get("name") or "", body.get("line")
    if not isinstance(name, str) or not isinstance(line, str):
        raise UsageError("give a name and a line, both text")
    return name, line


def _bytes(body: bytes) -> Response:
    return Response(body, media_type=MEDIA_TYPE)
