from lacet.daq.errors import LacetError as LacetError
from lacet.daq.errors import NotIdentifiable as NotIdentifiable
from lacet.daq.errors import UsageError as UsageError
from lacet.daq.formats.open_run import open_run as open_run
from lacet.daq.rig import Rig as Rig
from lacet.daq.run import Run as Run
from lacet.daq.vehicle import Vehicle as Vehicle
from lacet.identify.car.motion import CornerMotion as CornerMotion
from lacet.identify.car.motion import Motion as Motion
from lacet.identify.effects.base import Effect as Effect
from lacet.identify.effects.base import Parameter as Parameter
from lacet.identify.effects.base import PhysicalEffect as PhysicalEffect
from lacet.identify.effects.base import SensorFault as SensorFault
from lacet.identify.effects.base import SuspensionForce as SuspensionForce
from lacet.identify.effects.base import TyreForce as TyreForce
from lacet.identify.multibody.chain import Chain as Chain
from lacet.identify.multibody.chain import Joint as Joint
from lacet.identify.multibody.chain_base_parameters import base_parameters as base_parameters
from lacet.identify.regression.model import Model as Model
from lacet.identify.selection.candidate import Candidate as Candidate
from lacet.identify.signals.reconstruct import Recording as Recording
from lacet.services.library.chains import IdentifiedChain as IdentifiedChain
from lacet.services.library.chains import identify_chain as identify_chain
from lacet.services.library.comparisons import Comparison as Comparison
from lacet.services.library.comparisons import compare as compare
from lacet.services.library.exports import export as export
from lacet.services.library.fits import Fit as Fit
from lacet.services.library.fits import add as add
from lacet.services.library.fits import base_model as base_model
from lacet.services.library.fits import catalogue as catalogue
from lacet.services.library.fits import fit as fit
from lacet.services.library.pictures import waterfall as waterfall
from lacet.services.library.rankings import Ranking as Ranking
from lacet.services.library.rankings import rank as rank
from lacet.services.library.runs import LoadingWarning as LoadingWarning
from lacet.services.library.runs import Runs as Runs
from lacet.services.library.runs import load_runs as load_runs
from lacet.services.workspace.loading import load_chain as load_chain
from lacet.services.workspace.session import Session as Session
from lacet.services.workspace.study import Study as Study
from lacet.services.workspace.study import Version as Version

__all__ = [
    "Candidate",
    "Chain",
    "Comparison",
    "CornerMotion",
    "Effect",
    "Fit",
    "IdentifiedChain",
    "Joint",
    "LacetError",
    "LoadingWarning",
    "Model",
    "Motion",
    "NotIdentifiable",
    "Parameter",
    "PhysicalEffect",
    "Ranking",
    "Recording",
    "Rig",
    "Run",
    "Runs",
    "SensorFault",
    "Session",
    "Study",
    "SuspensionForce",
    "TyreForce",
    "UsageError",
    "Vehicle",
    "Version",
    "add",
    "base_model",
    "base_parameters",
    "catalogue",
    "compare",
    "export",
    "fit",
    "identify_chain",
    "load_chain",
    "load_runs",
    "open_run",
    "rank",
    "waterfall",
]
