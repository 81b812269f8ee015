"""CasADi functions as programs, which a small C evaluator runs for many columns at once."""

from .evaluate import ColumnFunctions as ColumnFunctions
from .listing import Listing as Listing
from .listing import listing_of as listing_of
from .operations import SOURCES as SOURCES
from .program import Program as Program
