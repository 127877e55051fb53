"""A rigid ball presses an elastic block: greenstage beside MuJoCo, in error and time.

    python3 -m venv venv && venv/bin/pip install numpy scipy mujoco-core==4.0.1
    taskset -c 0 venv/bin/python benches/peers/press.py --greenstage target/release/greenstage
    taskset -c 0 venv/bin/python benches/peers/press.py --greenstage target/release/greenstage --cells 26

The block is 0.2 x 0.1 x 0.2 m, Y up, Young's modulus 1e5 Pa, Poisson's ratio 0.3, its bottom held; the ball
has a radius of 0.1 m, no friction, and goes 1, 2 and 4 mm into the middle of the top. Both programs take the
same tetrahedra, five in each cube of a grid.

Neither program is the truth. Two references are computed by `reference.py`, with numpy and scipy alone:

same mesh   linear elasticity on these very tetrahedra, the ball touching their nodes: Signorini's problem,
            solved to rounding. The difference to it is the error of a program's contact.
truth       a quarter of the block by triquadratic hexahedra that are finer under the ball, on two grids, with
            their trend. The difference to it adds the error of the mesh.

Each program is compared with its own material law: greenstage's is linear elasticity, MuJoCo's Saint Venant
and Kirchhoff's, which adds the squares of the displacement's gradient to the strain. MuJoCo's ball touches
either small balls at the nodes, or the faces of the tetrahedra, as a flex does by itself; the reference does
likewise.

Force: greenstage writes the force on a control element that is held (effect `force_curve`, `view --check
--curve`), not that on a tool. So the ball stands still and the bed of the block, held by a stylus, comes up
by the depth: in the frame of the bed the same press, and the force on the bed is that on the ball.

Written for MuJoCo 4.0.1 (mujoco-core), numpy 2.4 and scipy 1.17; earlier MuJoCo gives flexes other elastic
constants, or lacks the integrator. Times are wall times of one process; pin it to one processor. With 10206
nodes it runs for a quarter of an hour."""

import argparse
import csv
import re
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from reference import DEPTHS, POISSON, RADIUS, SIZE, YOUNG, block, quarter, same_mesh, top, truth, write_medit

DENSITY = 1000.0
FRAME_S = 1 / 60


SCENE = """stage = "desktop"
script = "script.toml"

[tool.ball]
shape = {{ ball = {{ radius = {radius} }} }}
position = [0.0, {middle}, 0.0]

[body.block]
mesh = "block.mesh"
material = {{ young = {young}, poisson = {poisson} }}
effects = ["contact", "force_curve"]
effect.contact = {{ friction = 0.0 }}
place = {{ position = [0.0, 0.0, 0.0], scale = 1.0 }}

[body.block.control.bed]
nodes = {{ plane = {{ point = [0.0, {bottom}, 0.0], normal = [0.0, 1.0, 0.0], distance = 1e-6 }} }}
grab = "dragger"
"""
KEY = "\n[[key]]\ntime = {}\nstylus.hand = {{ {} }}\n"
HAND = -0.3


def script():
    """A stylus below the block holds its bed and lifts it to each depth in a second. 240 frames, as many as
    are played."""
    text = 'frame = "room"\n'
    text += KEY.format(0.0, f"position = [0.0, {HAND}, 0.0], direction = [0.0, 1.0, 0.0]")
    text += KEY.format(0.25, "pressed = true")
    for time_s, depth in zip([1.25, 2.25, 3.25, 3.75], DEPTHS + [1.025 * DEPTHS[-1]]):
        text += KEY.format(time_s, f"position = [0.0, {HAND + depth!r}, 0.0]")
    return text + KEY.format(239 * FRAME_S, "pressed = true")


def greenstage(program, nodes, tets):
    """Forces at each depth; times, the least of three runs, s: of a frame, median, 99 % and at most in the
    mean, and of the offline stage. The mean is that of the whole program, with its start and the reading of
    its file."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        write_medit(folder / "block.mesh", nodes, tets)
        middle = SIZE[1] / 2 + RADIUS
        (folder / "scene.toml").write_text(
            SCENE.format(radius=RADIUS, middle=middle, young=YOUNG, poisson=POISSON, bottom=-SIZE[1] / 2)
        )
        (folder / "script.toml").write_text(script())

        def run(*words):
            done = subprocess.run([program, *words], cwd=folder, capture_output=True, text=True)
            if done.returncode:
                raise SystemExit(done.stderr)
            if "warning" in done.stderr:
                print(done.stderr)
            return done.stdout

        def seconds(text, after):
            number, unit = re.search(after + r"\s*([\d.]+) (s|ms|µs)", text).groups()
            return float(number) * {"s": 1.0, "ms": 1e-3, "µs": 1e-6}[unit]

        times = []
        for _ in range(3):
            offline = seconds(run("precompute", "scene.toml", "--force"), "whole offline stage")
            begin = time.perf_counter()
            text = run("view", "scene.toml", "--check", "--curve", "curve.csv")
            mean = (time.perf_counter() - begin) / 240
            times.append([seconds(text, "frame: median"), seconds(text, "99 % within"), mean, offline])
        with open(folder / "curve.csv") as file:
            rows = [
                (float(row["displacement"]), float(row["force"]))
                for row in csv.DictReader(file)
                if row["force"]
            ]
        return np.interp(DEPTHS, *np.array(rows).T), np.min(times, 0)


# The stiffest contact that its implicit integrator takes: the largest impedance, and without `refsafe`.
STIFF = 'condim="1" solref="1e-5 1" solimp="0.9999 0.9999 0.001"'
# Rayleigh's damping, s, without which contact with faces trembles. It changes no equilibrium.
DAMPING = {"nodes": 0.0, "faces": 0.03}
# Radius of the balls of nodes, and by which a body of faces is thicker, m.
SKIN = 1e-5


def mujoco_model(nodes, tets, where, step_s, solver):
    """The block as a flex of all nodes, and the ball, which goes where it is put."""
    import mujoco

    bottom = np.flatnonzero(nodes[:, 1] < -SIZE[1] / 2 + 1e-9)
    words = lambda numbers: " ".join(map(repr, numbers.ravel().tolist()))
    faces = int(where == "faces")
    spec = mujoco.MjSpec.from_string(f"""<mujoco>
        <option gravity="0 0 0" timestep="{step_s}" integrator="discrete"
                solver="{solver}" iterations="400" tolerance="1e-8">
          <flag refsafe="disable"/>
        </option>
        <size memory="2G"/>
        <default><geom {STIFF}/></default>
        <worldbody>
          <flexcomp name="block" type="direct" dim="3" radius="{SKIN}" mass="{DENSITY * np.prod(SIZE)}"
                    point="{words(nodes)}" element="{words(tets)}">
            <pin id="{words(bottom)}"/>
            <elasticity young="{YOUNG}" poisson="{POISSON}" damping="{DAMPING[where]}"/>
            <contact selfcollide="none" contype="{faces}" conaffinity="{faces}" {STIFF}/>
          </flexcomp>
          <body name="ball" mocap="true"><geom type="sphere" size="{RADIUS - SKIN}"/></body>
        </worldbody></mujoco>""")
    if where == "nodes":
        for node in top(nodes, 0.04):
            geom = spec.body(f"block_{node}").add_geom()
            geom.size, geom.mass, geom.contype, geom.conaffinity = [SKIN, 0, 0], 0, 2, 1
    return spec.compile()


def mujoco_press(nodes, tets, where, step_s, solver="CG"):
    """Forces, penetrations and contacts at each depth, after a second of going down and half a second of
    rest; times, s: of a frame of 1/60 s, median, 99 % and mean, and of compiling the model; steps after which
    the force stays within 0.1 % of its last value if the ball is at the last depth at once, and its largest
    in the last ten steps over its least, less one."""
    import mujoco

    begin = time.perf_counter()
    model = mujoco_model(nodes, tets, where, step_s, solver)
    compiled_s = time.perf_counter() - begin
    data = mujoco.MjData(model)
    force = lambda: -data.qfrc_constraint.reshape(-1, 3)[:, 1].sum()
    times = []

    def step(depth):
        data.mocap_pos[0] = [0.0, SIZE[1] / 2 + RADIUS - depth, 0.0]
        begin = time.perf_counter()
        mujoco.mj_step(model, data)
        times.append(time.perf_counter() - begin)
        return force()

    rows = []
    for last, depth in zip([0.0] + DEPTHS, DEPTHS):
        for t in np.arange(0, 1.5, step_s):
            step(last + (depth - last) * (1 - np.cos(np.pi * min(t, 1.0))) / 2)
        rows.append((force(), -data.contact.dist.min(), data.ncon))
    frames = np.array(times[: len(times) // round(FRAME_S / step_s) * round(FRAME_S / step_s)])
    frames = frames.reshape(-1, round(FRAME_S / step_s)).sum(1)
    mujoco.mj_resetData(model, data)
    course = np.array([step(DEPTHS[-1]) for _ in range(round(1.0 / step_s))])
    away = np.flatnonzero(np.abs(course / course[-1] - 1) > 1e-3)
    ripple = course[-10:].max() / course[-10:].min() - 1
    settled = away[-1] + 1 if len(away) else 0
    return (
        np.array(rows),
        np.array([np.median(frames), np.quantile(frames, 0.99), frames.mean(), compiled_s]),
        settled,
        ripple,
    )


def percent(values, reference):
    """By how much values differ from others."""
    return "  ".join(f"{100 * (a / b - 1):+8.3f} %" for a, b in zip(values, reference))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--greenstage", required=True, type=Path, help="the program, a release build")
    parser.add_argument(
        "--cells", type=int, default=12, help="cells along the block, even: 12 has 1183 nodes, 26 has 10206"
    )
    parser.add_argument(
        "--truth", type=int, nargs=2, default=[6, 8], help="sizes of the two grids of the truth"
    )
    parser.add_argument("--only", default="", help="only runs with this in their names")
    args = parser.parse_args()
    if args.cells % 2:
        parser.error("an even number of cells has a node in the middle")

    print(f"depth {DEPTHS} m")
    print(f"Hertz {[round(4 / 3 * YOUNG / (1 - POISSON**2) * RADIUS**0.5 * d**1.5, 4) for d in DEPTHS]} N")
    grids = {cells: quarter(cells) for cells in args.truth}
    nodes, tets = block(args.cells)
    same = same_mesh(nodes, tets)
    real, reference = {}, {}
    for law in ["linear", "saint_venant"]:
        real[law], off = truth(grids, law)
        print(f"truth, {law}: {np.round(real[law], 4)} N; the finer grid is {100 * off:.2f} % off")
    print(f"same mesh: {len(nodes)} nodes, {len(tets)} tetrahedra")
    for law, where in [("linear", "nodes"), ("saint_venant", "nodes"), ("saint_venant", "faces")]:
        reference[law, where] = np.array([getattr(same, law)(depth, where) for depth in DEPTHS])
        print(f"  {law}, {where} touch: {np.round(reference[law, where], 4)} N")
        print(f"    to the truth      {percent(reference[law, where], real[law])}", flush=True)

    def show(name, forces, times, law, where, more=""):
        print(f"{name}: {np.round(forces, 4)} N")
        print(f"    to the same mesh  {percent(forces, reference[law, where])}")
        print(f"    to the truth      {percent(forces, real[law])}")
        median, most, mean = 1e3 * times[:3]
        print(f"    a frame: median {median:.2f} ms, 99 % within {most:.2f} ms, mean {mean:.2f} ms")
        print(f"    set-up {times[3]:.3f} s{more}", flush=True)

    if args.only in "greenstage":
        show("greenstage", *greenstage(args.greenstage.resolve(), nodes, tets), "linear", "nodes")
    try:
        import mujoco
    except ImportError:
        return print("MuJoCo is not installed")
    for where, steps in [("nodes", 1), ("nodes", 4), ("faces", 1), ("faces", 4)]:
        name = f"MuJoCo {mujoco.__version__}, {where} touch, {steps} steps a frame"
        if args.only not in name:
            continue
        rows, times, settled, ripple = mujoco_press(nodes, tets, where, FRAME_S / steps)
        more = f"; penetration {np.round(1e6 * rows[:, 1], 1)} µm, contacts {rows[:, 2].astype(int)}"
        more += f"; at rest {settled} steps after a jump to {DEPTHS[-1]} m, ripple {ripple:.0e}"
        show(name, rows[:, 0], times, "saint_venant", where, more)


if __name__ == "__main__":
    main()
