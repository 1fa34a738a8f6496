"""lacet: data acquisition and dynamic-parameter identification for an instrumented car.

    import lacet
    runs = lacet.load_runs("sine.mcap", "rough.mcap")
    fitted = lacet.fit(lacet.base_model(runs), runs)
    print(fitted.summary())
    lacet.rank(fitted)

General layout, each a folder of this package:

- ``daq``: channels, units, rigs, vehicles, runs; file formats and the bus
- ``drivers``: one sensor a file, frames in and blocks out
- ``identify``: multibody models, effects, regression, validation, selection of effects, design of runs
- ``simulate``: the independent simulated car
- ``services``: acquisition, studies, plots and reports, the workbench, the commands

What is listed in ``__all__`` is public, and loaded when it is first used.
"""

from importlib import import_module as _import_module
from pathlib import Path as _Path

_ROOMS = ("daq", "drivers", "identify", "services", "simulate")
_NAMES = {
    "lacet.daq.errors": ("LacetError", "NotIdentifiable", "UsageError"),
    "lacet.daq.formats.open_run": ("open_run",),
    "lacet.daq.rig": ("Rig",),
    "lacet.daq.run": ("Run",),
    "lacet.daq.vehicle": ("Vehicle",),
    "lacet.identify.car.motion": ("CornerMotion", "Motion"),
    "lacet.identify.effects.base": (
        "Effect",
        "Parameter",
        "PhysicalEffect",
        "SensorFault",
        "SuspensionForce",
        "TyreForce",
    ),
    "lacet.identify.multibody.chain": ("Chain", "Joint"),
    "lacet.identify.multibody.chain_base_parameters": ("base_parameters",),
    "lacet.identify.regression.model": ("Model",),
    "lacet.identify.selection.candidate": ("Candidate",),
    "lacet.identify.signals.reconstruct": ("Recording",),
    "lacet.services.library.chains": ("IdentifiedChain", "identify_chain"),
    "lacet.services.library.comparisons": ("Comparison", "compare"),
    "lacet.services.library.exports": ("export",),
    "lacet.services.library.fits": ("Fit", "add", "base_model", "catalogue", "fit"),
    "lacet.services.library.pictures": ("waterfall",),
    "lacet.services.library.rankings": ("Ranking", "rank"),
    "lacet.services.library.runs": ("LoadingWarning", "Runs", "load_runs"),
    "lacet.services.workspace.loading": ("load_chain",),
    "lacet.services.workspace.session": ("Session",),
    "lacet.services.workspace.study": ("Study", "Version"),
}
_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}

__all__ = sorted(_MODULE_OF)  # pyrefly: ignore[unresolvable-dunder-all]

if _lost := [name for name in _ROOMS if not (_Path(__file__).parent / name).is_dir()]:
    # A checkout on Windows: git has written the links as small text files.
    raise ImportError(
        f"this checkout of lacet has no working links ({', '.join(f'lacet/{name}' for name in _lost)}). "
        "Install the wheel instead (pip install lacet), or let git make links: turn on Windows' developer mode, "
        "then run 'git config core.symlinks true' and 'git checkout -- lacet' in the checkout."
    )


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'lacet' has no attribute {name!r}")
    value = globals()[name] = getattr(_import_module(_MODULE_OF[name]), name)
    return value


def __dir__() -> list[str]:
    return [*__all__, *_ROOMS]
