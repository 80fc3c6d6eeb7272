"""
A finger rolls a pen
====================

MuJoCo moves a finger over a pen on a table; a fingertip of 16 strips lies on it and reads at each step.
"""

import matplotlib.pyplot as plt
import mujoco

import tacstrip as ts

model = mujoco.MjModel.from_xml_string("""<mujoco><option timestep=".001" cone="elliptic" impratio="20"/>
  <default><geom solref=".004 1"/></default><worldbody><geom type="plane" size=".1 .1 .01"/>
  <body pos="-.003 0 .004"><freejoint/><geom name="pen" type="capsule" size=".004 .07" euler="90 0 0"/></body>
  <body name="finger" pos="-.006 0 .0167"><joint name="x" type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
    <geom size=".009" mass=".1"/><site name="tip" euler="0 140 0"/></body></worldbody>
  <actuator><position joint="x" kp="200" kv="5"/></actuator></mujoco>""")
data, fingertip, noise = mujoco.MjData(model), ts.Sensor.load("fingertip"), ts.Noise(positional=0.002)
skin = ts.mujoco_skin(model, fingertip, site="tip", noise=noise, geoms=["pen"])  # 1 mm thicker than the bone

x_mm, outlines = [], []
for step in range(100):
    data.ctrl = 0.012 * step / 100
    mujoco.mj_step(model, data, 10)
    patch = skin.press(data)
    scan = skin.read(data, patch)
    x_mm.append([1e3 * data.body("finger").xpos[0], 1e3 * data.geom("pen").xpos[0]])
    outlines.append(patch.outline_xyz)
found = ts.fit_solid(scan, fingertip, ts.Solid.cylinder(6.0), noise)
print(f"the pen's radius by the last scan: {found.radius_mm:.2f} +- {found.radius_sigma_mm:.2f} mm")

# %%
# The pen (orange) rolls half as far as the finger; its patch wanders over the skin: here after .2, .5 and .8 s.
figure, (left, right) = plt.subplots(1, 2, figsize=(7, 2.9), layout="constrained")
left.plot([x for x, _ in x_mm], "-", [x for _, x in x_mm], "--")
left.set(xlabel="step of 10 ms", ylabel="x [mm]", title="finger (solid), pen (dashed)")
right.plot(*[xy for outline in outlines[20::30] for xy in outline[:, :2].T])
right.set(xlabel="x on the fingertip [mm]", ylabel="y [mm]", aspect="equal")
