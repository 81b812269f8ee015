"""What a plan keeps clear of: the interface of such kinds, and the two that every planner has."""
