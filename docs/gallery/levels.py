"""
Level policies
==============

How large is each region? A level policy says which probability every region leaves out, step by step. ``fixed`` keeps
one tail; ``discounted`` cares less about the distant future; ``risk_allocation`` shares one risk among all steps.
"""

import matplotlib.pyplot as plt

from wideberth import build

STEPS = 15
region = build("regions", "minimum_trace")
policies = {
    "fixed": "fixed",
    "discounted": {"type": "discounted", "tail": 0.05, "final_tail": 0.5},
    "risk_allocation": {"type": "risk_allocation", "tail": 0.05, "promise": "risk"},
}

figure, ax = plt.subplots(figsize=(7, 3.5), layout="constrained")
for mark, (name, config) in zip("os^", policies.items(), strict=True):
    levels = build("levels", config).levels(region, STEPS, obstacles=1, dimension=2)
    tails = [region.tail(level) for level in levels[:, 0]]
    ax.semilogy(range(1, STEPS + 1), tails, f"{mark}-", markersize=4, label=name)
ax.set(xlabel="step of the plan", ylabel="tail of the region")
ax.legend()
