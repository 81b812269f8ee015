"""The optimal control problem of one plan, and its transcriptions."""
