# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .best_half_plane import BestHalfPlane as BestHalfPlane
from .bhattacharyya import Bhattacharyya as Bhattacharyya
from .du_toit import DuToit as DuToit
from .eigen_rectangle import EigenRectangle as EigenRectangle
from .half_plane import HalfPlane as HalfPlane
from .luetkepohl_rectangle import LuetkepohlRectangle as LuetkepohlRectangle
from .mahalanobis_ellipse import MahalanobisEllipse as MahalanobisEllipse
from .minimum_area import MinimumArea as MinimumArea
from .minimum_trace import MinimumTrace as MinimumTrace
from .minkowski_sum import MinkowskiSum as MinkowskiSum
from .park import Park as Park
from .repaired_level import RepairedLevel as RepairedLevel
from .repaired_margin import RepairedMargin as RepairedMargin
from .risk_contour import RiskContour as RiskContour
from .separating_line import SeparatingLine as SeparatingLine
from .whitened_box import WhitenedBox as WhitenedBox
__all__ = ['BestHalfPlane', 'Bhattacharyya', 'DuToit', 'EigenRectangle', 'HalfPlane', 'LuetkepohlRectangle', 'MahalanobisEllipse', 'MinimumArea', 'MinimumTrace', 'MinkowskiSum', 'Park', 'RepairedLevel', 'RepairedMargin', 'RiskContour', 'SeparatingLine', 'WhitenedBox']
BUILT_IN: dict[str, str]
