"""Cached values of a study's versions: what each depends on, and where it is kept."""

from __future__ import annotations

import inspect
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from lacet.identify.effects.base import Effect
from lacet.identify.effects.catalogue import base_model, effect_classes
from lacet.identify.effects.language.compiled import OneLine
from lacet.identify.effects.user_files import is_own
from lacet.services.cache.keys import key_of, run_digests, service_sources, text_digest
from lacet.services.cache.store import Store
from lacet.services.workspace.study import Study, Version

T = TypeVar("T")


class StudyCache:
    """Values that were computed for a study, kept in its folder under what they depend on.

    Parameters
    ----------
    study : the study, with the runs that its values are of.
    """

    def __init__(self, study: Study):
        self.study = study
        self.store = Store(study.folder)

    def kept(self, kind: str, key: str, compute: Callable[[], T]) -> T:
        """The value of a key: as it is kept, or computed and kept from now on."""
        found: T | None = self.store.load(kind, key)
        if found is None:
            found = compute()
            self.store.save(kind, key, found)
        return found

    def key(self, room: str, version: Version, reference: str, *more: object, catalogue: bool = False) -> str:
        """Key of a value of a version's model on the runs used.

        Parameters
        ----------
        room : the room of `lacet.identify` that makes the value.
        reference : wheel reference of the runs.
        more : what else it depends on, as JSON data: runs held out (`runs_key`), settings.
        catalogue : whether it depends on every effect of the catalogue and of the study, and not only on the model's.
        """
        study = self.study
        known = study.effects(reference)
        added = [known[key] for key in version.effects if key in known]
        model = {type(effect) for effect in (*base_model(study.vehicle, reference), *added)}
        own = [_definition(cls) for cls in sorted(model, key=lambda cls: cls.name)]
        if catalogue:
            own = [text_digest(file) for file in sorted((study.folder / "effects").glob("*")) if file.is_file()]
        return key_of(
            room, None if catalogue else model, self._filters,
            [[key, dict(shape)] for key, shape in version.effects.items()], sorted(set(version.effects) - set(known)),
            [one for one in own if one], self.runs_key(held=False),
            text_digest(study.folder / "rig.toml"), text_digest(study.folder / "vehicle.toml"), *more,
        )  # fmt: skip

    def recordings_key(self, held: bool) -> str:
        """Key of the runs themselves, used or held out, as they are read, checked and brought to one grid."""
        folder, base = self.study.folder, [cls for cls in effect_classes().values() if cls.base]
        return key_of(
            "validation", base, self._filters, held, self.runs_key(held), text_digest(folder / "rig.toml"),
            text_digest(folder / "vehicle.toml"), service_sources("render", "workspace"),
        )  # fmt: skip

    @property
    def _filters(self) -> list[float | None]:
        """The settings of the filters."""
        filters = self.study.filters
        return [filters.rate, filters.pre_cutoff, filters.fit_cutoff, filters.order, filters.edge]

    def runs_key(self, held: bool) -> list[list[str]]:
        """Names and digests of the contents of the runs used, or of those held out."""
        paths = self.study.paths(held)
        return [list(pair) for pair in zip(_names(paths), run_digests(self.study.folder, paths), strict=True)]


def _definition(cls: type[Effect]) -> object:
    """A user's effect as JSON data: the digest of its file, or its line; None for an effect of lacet."""
    if issubclass(cls, OneLine):
        laws = [[law.named, law.text] for law in cls.line.rows]
        return [cls.name, laws, list(cls.line.places), dict(cls.grids), cls.plausible]
    return text_digest(Path(inspect.getfile(cls))) if is_own(cls) else None


def _names(paths: Sequence[Path]) -> list[str]:
    """Names of runs in results: their folder counts where two have one name."""
    stems = Counter(path.stem for path in paths)
    return [path.name if stems[path.stem] == 1 else f"{path.resolve().parent.name}/{path.name}" for path in paths]
