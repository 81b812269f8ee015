"""
6. A figure for a paper
=======================

From a question to a table in LaTeX and a figure: a config says what is compared, ``run`` measures, and the result is
a folder that others can repeat. The question of this page: what does it cost a robot to keep clear of *where people
may be*, instead of *where they are expected*?
"""

# %%
# The config
# ----------
# A config is a YAML file. ``<<: recommended`` inserts the settings of the recommended planner; the second planner
# differs in one line: its regions hold 0.1 % of where people may be, and so shrink to discs around the places where
# people are expected. Every seed draws a situation, and both planners meet the same ones. For a paper take twenty
# seeds or more; three are enough to see how it works.

from pathlib import Path
from tempfile import mkdtemp

folder = Path(mkdtemp())  # take one of your own
config = """
type: comparison
scenarios:
  field: {type: crossing_field, walkers: 4, reach: 5.0}
robots:
  unicycle: &robot {type: unicycle, radius: 0.4}
controllers:
  uncertain:
    <<: recommended
    robot: *robot
  certain:
    <<: recommended
    robot: *robot
    level: {type: fixed, tail: 0.999}  # 1 - content
baseline: uncertain
seeds: 3
show: [0]
"""
file = folder / "caution.yaml"
_ = file.write_text(config)

# %%
# Run it
# ------
# In a shell this is ``wideberth run caution.yaml``. A run that is stopped goes on when the same command is given
# again, and ``--set seeds=20`` adds seeds to what is there.

import wideberth

result = wideberth.run(file, folder=folder / "caution")

# %%
# The table
# ---------
# The tables of a result are pandas data frames: ``table`` has one line per episode, ``tables["summary"]`` one per
# planner. ``wideberth.open_result`` opens the folder again another day. The guide :doc:`/results` says what the columns
# mean.

table = result.table
print(table[["controller", "seed", "outcome", "duration", "clearance"]].to_string(index=False))

# %%
# For the paper, some columns of the summary as LaTeX. In a shell it is ``wideberth show caution --columns
# controller,success,collision,clearance_min_m --latex``.

from wideberth.experiments import extract, latex_text

columns = ["controller", "success", "collision", "clearance_min_m"]
print(latex_text(extract(folder / "caution", columns)))

# %%
# The figure
# ----------
# The same seed is the same situation, therefore the two planners are compared pair by pair. ``paper_style`` has the
# sizes and fonts of a printed column. Below zero the robot has touched a person.

import matplotlib.pyplot as plt

from wideberth.draw import COLOURS, paper_style

with paper_style():
    figure, ax = plt.subplots()
    for i, (name, rows) in enumerate(table.groupby("controller")):
        ax.plot(
            rows["duration"],
            rows["clearance"],
            marker="os"[i],
            linestyle="none",
            color=COLOURS[i + 1],
            label=name,
        )
    pairs = table.pivot(index="seed", columns="controller")
    for _, pair in pairs.iterrows():
        ax.plot(pair["duration"], pair["clearance"], "0.7", linewidth=0.6, zorder=0)
    ax.axhline(0.0, color="k", linewidth=0.6)
    ax.set(xlabel="duration (s)", ylabel="smallest clearance (m)")
    figure.legend(title="a line joins the same situation", loc="outside lower center", ncols=2)
    figure.savefig(folder / "caution.pdf")

# %%
# And one of the episodes, to see what happened:

episode = result.episodes["field-unicycle-nominal-uncertain-0"]
episode.plot()

# %%
# A film shows it in motion. In a notebook it plays below the cell; ``.save("caution.gif")`` writes it to a file.

episode.animate(rate=5.0)

# %%
# The folder holds the config with every default, versions and commit, and the measured values, so that another person
# gets the same bytes. ``wideberth report caution`` writes its tables and pictures as Markdown, and ``wideberth cite
# caution.yaml`` prints what to cite.
