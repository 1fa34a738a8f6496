"""``lacet check``: check sensors against the rig file and each other: noise, latencies, position, noise bias."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from lacet.daq.errors import UsageError
from lacet.daq.formats.result import DONE, write_result
from lacet.daq.sources.open_source import is_bag
from lacet.identify.effects.catalogue import base_model, catalogue, find_effect
from lacet.identify.progress import Stage
from lacet.identify.regression.instrumental_variables import fit_instruments, pairs_of
from lacet.identify.regression.latency import Timings, estimate_latencies
from lacet.identify.regression.model import Model
from lacet.identify.regression.wls import fit
from lacet.identify.signals.noise_level import measured_noise
from lacet.identify.validation.channels.speed_agreement import SpeedAgreement
from lacet.identify.validation.channels.unit_position import unit_position
from lacet.identify.validation.score import compare, worst_row
from lacet.services.commands.progress import Line
from lacet.services.progress import Progress, ServiceStage, ServiceStep, planned
from lacet.services.render import sensor_report
from lacet.services.timing.usual import stretch
from lacet.services.workspace import sensor_check as checking
from lacet.services.workspace.loading import Loaded, default_filters, load
from lacet.services.workspace.results import scores
from lacet.services.workspace.rig_text import with_latencies
from lacet.services.workspace.study import Study

HELP = "check the sensors against the rig file and each other, and the fit for bias by noise"
DESCRIPTION = """\
Check from ordinary runs whether the sensors are as the rig file says, by five questions:

  noise     each channel's noise from the upper part of its spectrum, against the rig's sheet
  agreement the inertial unit against the speed sensor, by their motion alone: no model and no force enters
  latency   each sensor's latency, estimated together with the model's parameters, against the rig's
  position  where the inertial unit is, by axis, estimated in the same way, against the rig's
  bias      whether noise biases the parameters, and whether the sheet's noise explains it: even and odd samples of
            every channel are fitted as each other's instruments (Durbin-Wu-Hausman test)

  lacet check STUDY                                   with the study's runs and its present model
  lacet check run1.mcap run2.mcap --add anti_roll_bar.front
  lacet check sine.parquet rough.parquet --rig rig.toml --vehicle vehicle.toml --only latency --write-rig new.toml

Latencies are relative to a time base, the sensor of the wheel loads: a common shift of all cannot be seen. One whose
interval is wider than 5 ms is not testable with these runs; fast steering and rough roads help. Latencies follow what
a model lacks, so diagnose first. Position and bias are answered with the latencies found, where these are asked for."""

QUESTIONS = ("noise", "agreement", "latency", "position", "bias")
_DRAWS = 6


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("runs", metavar="RUN|STUDY", nargs="+", type=Path, help="runs, or the folder of one study")
    parser.add_argument("--map", metavar="FILE", type=Path, help="channel map of logs that other systems wrote")
    parser.add_argument("--rig", help="rig file, or the name of one shipped; default: the one in the run or study")
    parser.add_argument("--vehicle", help="vehicle file, or the name of one shipped; default: that of the run or study")
    parser.add_argument("--add", metavar="EFFECT", action="append", default=[], help="an effect beyond the model")
    parser.add_argument("--cutoff", metavar="HZ", type=float, help="cut-off of the fit (default 6 Hz, or the study's)")
    parser.add_argument("--only", choices=QUESTIONS, action="append", help="answer this question; again for more")
    parser.add_argument(
        "--time-base", metavar="SENSOR", help="sensor the others are estimated against (default: the loads')"
    )
    parser.add_argument("--write-rig", metavar="FILE", type=Path, help="write the rig with the latencies that differ")


def run(args: argparse.Namespace) -> int:
    """Run the checks asked for; returns 0 when they could be made."""
    asked = tuple(args.only or QUESTIONS)
    if args.write_rig is not None:
        if "latency" not in asked:
            raise UsageError("--write-rig writes the latencies found: ask for them (--only latency)")
        if args.write_rig.exists():
            raise UsageError(f"--write-rig {args.write_rig}: already there; give another name")
    result: dict[str, Any] = {}
    with Line("check") as line:
        stages = [ServiceStage.READING_RUN]
        stages += [Stage.LATENCIES, ServiceStage.COMPARING] * ("latency" in asked)
        stages += [ServiceStage.FITTING] * (bool({"position", "bias"} & set(asked)) and "latency" not in asked)
        stages += [ServiceStage.POSITION] * ("position" in asked) + [ServiceStage.INSTRUMENTS] * ("bias" in asked)
        line.progress(planned(stretch(stage, len(args.runs)) for stage in stages))
        loaded, model = _load(args, line.progress)
        result |= {
            "vehicle": loaded.vehicle.name,
            "rig": loaded.rig.name,
            "runs": [run.name for run in loaded.runs],
            "effects": [effect.key for effect in model.effects],
        }
        print(
            f"{loaded.vehicle.name}, {len(loaded.runs)} run{'s' if len(loaded.runs) > 1 else ''}, rig {loaded.rig.name}"
        )
        if "noise" in asked:
            levels = measured_noise(loaded.runs, loaded.rig)
            result["noise"] = checking.noise_result(levels)
            print(f"\nNoise, 1 σ at the sensors' own rates:\n{sensor_report.noise_table(result['noise'])}", flush=True)
        if "agreement" in asked:
            result["agreement"] = checking.agreement_result(SpeedAgreement.of(loaded.prepared))
            says = sensor_report.agreement_text(result["agreement"])
            print(f"\nInertial unit and speed sensor, whatever forces act:\n{says}", flush=True)
        fitted = None
        if "latency" in asked:
            filters = loaded.prepared[0].recording.filters
            timings = estimate_latencies(
                model,
                loaded.runs,
                loaded.vehicle,
                loaded.rig,
                filters,
                args.time_base,
                lambda step: line.progress(replace(step, total=0)),  # the search ends sooner than it may
            )
            fitted = timings.fit
            line.progress(ServiceStep(ServiceStage.COMPARING))
            trust = worst_row(scores([compare(fitted, drive, _DRAWS) for drive in fitted.runs]))
            result["latency"] = checking.latency_result(timings, trust)
            print(
                f"\nLatencies, when that of '{timings.base}' is right:\n{sensor_report.latency_table(timings)}",
                flush=True,
            )
            if trust[1] > checking.DISTRUST:
                print(sensor_report.distrusted(trust))
            if not timings.settled:
                print(f"The search had not settled after {timings.steps} readings: distrust these values.")
            if args.write_rig is not None:
                _write(args.write_rig, loaded, timings)
        if fitted is None and {"position", "bias"} & set(asked):
            line.progress(ServiceStep(ServiceStage.FITTING))
            fitted = fit(model, loaded.prepared)
        if "position" in asked and fitted is not None:
            line.progress(ServiceStep(ServiceStage.POSITION))
            axes = unit_position(fitted)
            result["position"] = checking.position_result(axes)
            print(f"\nInertial unit, in body axes:\n{sensor_report.position_table(axes)}", flush=True)
        if "bias" in asked and fitted is not None:
            line.progress(ServiceStep(ServiceStage.INSTRUMENTS))
            found = fit_instruments(fitted, pairs_of(fitted, loaded.runs))
            result["bias"] = checking.bias_result(found, loaded.vehicle)
            print(f"\nBias by noise:\n{sensor_report.bias_text(result['bias'])}")
    for warning in loaded.said:
        print(f"! {warning}")
    write_result(args.json, "check", {**result, "warnings": list(loaded.warnings)})
    return DONE


def _load(args: argparse.Namespace, progress: Progress) -> tuple[Loaded, Model]:
    """The runs and the model: a study's own, or the base model for runs given one by one."""
    folders = [path for path in args.runs if path.is_dir() and not is_bag(path)]
    if not folders:
        loaded = load(args.runs, args.rig, args.vehicle, default_filters(args.cutoff), progress, args.map, raw=True)
        model = Model.of(base_model(loaded.vehicle, loaded.reference))
        known = catalogue(loaded.vehicle, loaded.reference)
    else:
        if len(args.runs) > 1:
            raise UsageError("give runs, or the folder of one study, not both")
        study = Study.open(folders[0])
        filters = study.filters if args.cutoff is None else default_filters(args.cutoff)
        rig, vehicle = args.rig or study.folder / "rig.toml", args.vehicle or study.folder / "vehicle.toml"
        loaded = load(study.paths(), rig, vehicle, filters, progress, raw=True)
        model = study.model(study.version(), loaded.reference)
        known = study.effects(loaded.reference)
    rigs = {drive.recording.rig.text for drive in loaded.prepared}
    if len(rigs) > 1:
        raise UsageError("the runs carry different rig files: check those of one rig together, or name one with --rig")
    for key in args.add:
        model = model + find_effect(key, known)
    return loaded, model


def _write(file: Path, loaded: Loaded, timings: Timings) -> None:
    """Write the rig file with the latencies that differ, all of them shifted alike where one would be negative."""
    latencies = {s.name: s.latency for s in loaded.rig.sensors}
    latencies |= {s.sensor: s.found for s in timings.sensors if s.testable and not s.agrees}
    if (lowest := min(latencies.values())) < 0.0:
        print(f"All latencies written are {-1e3 * lowest:.2f} ms later: none may be negative, and it changes nothing.")
        latencies = {name: value - lowest for name, value in latencies.items()}
    changed = {s.name: latencies[s.name] for s in loaded.rig.sensors if abs(latencies[s.name] - s.latency) > 1e-9}
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(with_latencies(loaded.rig.text, changed), encoding="utf-8")
    except OSError as error:
        raise UsageError(f"--write-rig {file}: cannot be written: {error.strerror}") from None
    changes = ", ".join(f"{name} {1e3 * value:.2f} ms" for name, value in changed.items())
    print(f"{file}: the rig with {changes or 'nothing changed: all latencies agree or are not testable'}")
