# %% [markdown]
# # Two anti-roll bars are missing, and found
#
# Runs of a car whose base model lacks both anti-roll bars: fit, compare, rank, add. In a clone, with `pip install '.[plots]'`; the runs are in `tests/data/car`.
# With a log of your own, its file name is enough: a log carries its rig and vehicle.

# %%
import lacet

files = {"rig": "tests/data/car/rig.toml", "vehicle": "tests/data/car/vehicle.toml"}
used = lacet.load_runs("tests/data/car/sine.parquet", "tests/data/car/liftoff.parquet", **files)
held = lacet.load_runs("tests/data/car/rough.parquet", **files)
base = lacet.fit(lacet.base_model(used), used)
print("\n".join(base.summary().splitlines()[:12]))

# %% [markdown]
# ## Model against measurement
# The model was fitted to the runs used. The rough road is held out: the model has not seen it. An error ÷ noise floor of 1 is what the sensors' noise alone leaves.

# %%
on_held = lacet.compare(base, held)
on_held

# %%
on_held.plot("rough", ["suspension.fl", "chassis.mx"])

# %% [markdown]
# Where does it fail? In the four suspension rows, whenever the car rolls.

# %%
on_used = lacet.compare(base)
on_used.plot_map()

# %% [markdown]
# ## What is missing?
# Every effect of the catalogue is tested beside the model, and its gain is compared with what chance would give in runs that lack nothing.

# %%
ranking = lacet.rank(base)
print(ranking.explain())
ranking.plot()

# %% [markdown]
# ## Add it, and see the error fall

# %%
front = lacet.add(base, "anti_roll_bar.front")
both = lacet.add(front, "anti_roll_bar.rear")
steps = {"base model": on_held, "front bar": lacet.compare(front, held), "rear bar": lacet.compare(both, held)}
lacet.waterfall(steps)

# %% [markdown]
# ## The parameters
# With 95 % intervals: thick by noise, thin with the tolerances of the sensor sheet. This car was simulated, so its true values are known (crosses).

# %%
import json
from pathlib import Path

truth = json.loads(Path("tests/data/car/truth.json").read_text(encoding="utf-8"))
bars = truth["anti_roll_bar_N_per_m_of_travel_difference"]
known = {f"anti_roll_bar.{axle}.k": bars[axle] for axle in ("front", "rear")}
for corner, axle in {"fl": "front", "fr": "front", "rl": "rear", "rr": "rear"}.items():
    known |= {f"spring.{corner}.k": truth["suspension"][axle]["k_N_m"]}
    known |= {f"damper.{corner}.c": truth["suspension"][axle]["c_Ns_m"]}
both.plot(known, known)
