"""Costs of Nav2's cells by the names that Nav2 has for them."""

from wideberth.framework.values.costmap import COSTS

FREE_SPACE, MAX_NON_OBSTACLE, INSCRIBED, LETHAL, NO_INFORMATION = COSTS
