"""The fallback ladder: verified plans, best first, and ways to stop."""
