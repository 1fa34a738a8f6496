"""Server of the workbench: its parts connected, and its life from start to Ctrl-C."""

from __future__ import annotations

import contextlib
import errno
import socket
import sys
import webbrowser
from collections.abc import AsyncGenerator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

import uvicorn
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.staticfiles import StaticFiles

from lacet.daq.bus.credentials import Credentials
from lacet.daq.errors import LacetError, UsageError
from lacet.identify.validation.noise_floor import DEFAULT_DRAWS
from lacet.services.workbench.access_guard import Guard, new_token, user_token
from lacet.services.workbench.events import Events, Watch
from lacet.services.workbench.job_record import JobRecord
from lacet.services.workbench.jobs import Jobs
from lacet.services.workbench.live import Live
from lacet.services.workbench.live_fit import LiveFitProcess
from lacet.services.workbench.refusals import DiskFull, Refusal
from lacet.services.workbench.routes import Bench, api
from lacet.services.workbench.run_channels import RunChannels
from lacet.services.workbench.run_files import RunFiles, undecoded
from lacet.services.workbench.session_cache import SessionCache
from lacet.services.workbench.tasks import Tasks
from lacet.services.workbench.uploads import MOST, sweep

STATIC = Path(__file__).parent / "static"


@dataclass(frozen=True)
class Settings:
    """Settings of the server.

    `folder` : the study's, existing or not; `host`, `port` : address, port 0 for any that is free; `hosts` : further
    names of the server; `token` : must be given where it listens elsewhere than on loopback; `most_upload` [bytes];
    `connect` : router of the live recording; `draws` : noise-floor simulations of a new study; `credentials` : keys
    for that router.
    """

    folder: Path
    host: str = "127.0.0.1"
    port: int = 8765
    hosts: tuple[str, ...] = ()
    token: str | None = None
    most_upload: int = MOST
    connect: str | None = None
    draws: int = DEFAULT_DRAWS
    credentials: Credentials | None = None


def is_loopback(host: str) -> bool:
    """Whether an address can be reached from this machine only."""
    return host in ("localhost", "::1") or host.startswith("127.")


def create_app(settings: Settings) -> FastAPI:
    """The application; its threads live from its start-up to its shut-down."""

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncGenerator[None]:
        events = Events()
        cache = SessionCache(settings.folder)
        sweep(cache)
        channels = RunChannels(settings.folder)
        files = RunFiles(cache, channels)
        record = JobRecord(settings.folder)
        jobs = Jobs(Tasks(cache, files, settings.draws).by_name(), events, record)
        jobs.restore([one for one in record.unfinished() if one["do"] in jobs.tasks and one["do"] != "decode"])
        for capture in undecoded(cache):  # decoding was interrupted with an earlier server
            jobs.submit("decode", {"file": capture.name})
        live, watch = Live(settings.connect, events, settings.credentials), Watch(settings.folder, events)
        live_fit = LiveFitProcess(settings.folder, settings.connect, settings.credentials, events)
        app.state.bench = Bench(cache, jobs, events, files, channels, live, live_fit, settings.most_upload)
        try:
            yield
        finally:
            events.close()
            watch.close()
            live.close()
            live_fit.close()
            jobs.close()

    app = FastAPI(title="lacet", lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None)
    app.include_router(api)
    app.mount("/", StaticFiles(directory=STATIC, html=True), name="page")
    app.add_middleware(Guard, hosts=(settings.host, *settings.hosts), token=settings.token)
    app.add_exception_handler(LacetError, _refused)
    app.add_exception_handler(OSError, _failed)
    app.add_exception_handler(RequestValidationError, _misread)
    app.add_exception_handler(HTTPException, _plain)
    app.add_exception_handler(Exception, _bug)
    return app


def _refused(_: Request, error: Exception) -> JSONResponse:
    status, extra = (error.status, error.extra) if isinstance(error, Refusal) else (400, {})
    return JSONResponse({"error": str(error), **extra}, status)


def _failed(_: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, OSError)
    status = DiskFull.status if error.errno in (errno.ENOSPC, errno.EDQUOT) else 500
    return JSONResponse({"error": f"{error.filename or ''}: {error.strerror or error}".lstrip(": ")}, status)


def _misread(request: Request, error: Exception) -> JSONResponse:
    found = error.errors() if isinstance(error, RequestValidationError) else []
    places = [": ".join(filter(None, (".".join(map(str, e["loc"][1:])), str(e["msg"])))) for e in found]
    said = f"the question cannot be read: {'; '.join(places)[:400]}"
    if not request.headers.get("content-type", "").startswith("application/json"):
        said += ". Send it as JSON: Content-Type: application/json"
    return JSONResponse({"error": said}, 400)


def _plain(_: Request, error: Exception) -> JSONResponse:
    status, text = (error.status_code, error.detail) if isinstance(error, HTTPException) else (500, str(error))
    return JSONResponse({"error": str(text)}, status)


def _bug(_: Request, error: Exception) -> JSONResponse:
    """Answer to an unexpected exception, whose traceback goes to the terminal."""
    return JSONResponse({"error": f"an error of lacet itself: {type(error).__name__}: {error}"}, 500)


class _Server(uvicorn.Server):
    """uvicorn server that ends the pages' event streams on shut-down, which they would otherwise prevent."""

    def __init__(self, config: uvicorn.Config, app: FastAPI):
        super().__init__(config)
        self._app = app

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        found = getattr(self._app.state, "bench", None)
        if found is not None:
            found.events.close()
            found.jobs.stop()
        super().handle_exit(sig, frame)


def serve(settings: Settings, open_browser: bool = False) -> None:
    """Run until Ctrl-C. Raises UsageError when the server cannot listen on its address."""
    if not is_loopback(settings.host) and settings.token is None:
        raise UsageError(f"listening on {settings.host} needs a token: leave --no-token out")
    app = create_app(settings)
    config = uvicorn.Config(
        app, log_level="warning", access_log=False, timeout_graceful_shutdown=5, server_header=False
    )
    with _listening(settings) as own:
        port = own.getsockname()[1]
        print(f"lacet ui: {_where(settings)}\n  open {address(settings, port)}\n  Ctrl-C ends it", flush=True)
        if open_browser:
            webbrowser.open(address(settings, port))
        with contextlib.suppress(KeyboardInterrupt):  # Ctrl-C is the normal end
            _Server(config, app).run(sockets=[own])
    print("lacet ui: ended", file=sys.stderr)


def _where(settings: Settings) -> str:
    there = (settings.folder / "study.json").is_file()
    return f"the study {settings.folder}" if there else f"a new study in {settings.folder}"


def address(settings: Settings, port: int) -> str:
    """Address to open in a browser."""
    host = settings.host
    if host in ("0.0.0.0", "::", ""):
        host = socket.gethostname()
    text = f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"
    return f"{text}?token={settings.token}" if settings.token else text


def _listening(settings: Settings) -> socket.socket:
    try:
        found = socket.getaddrinfo(settings.host, settings.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        own = socket.socket(found[0], socket.SOCK_STREAM)
    except OSError as error:
        raise UsageError(f"--host {settings.host}: {error.strerror or error}") from None
    try:
        own.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        own.bind(found[4])
        own.listen(128)
    except OSError as error:
        own.close()
        raise UsageError(
            f"cannot listen on {settings.host}, port {settings.port}: {error.strerror}; give another with --port, "
            "or --port 0 for any that is free"
        ) from None
    return own


def settings_of(args: Any, credentials: Credentials | None = None) -> Settings:
    """The settings of the command line's arguments."""
    token = None if args.no_token else user_token() if is_loopback(args.host) else new_token()
    return Settings(
        args.study,
        args.host,
        args.port,
        tuple(args.name),
        token,
        int(args.most_upload * 1e9),
        args.connect,
        args.draws,
        credentials,
    )
