"""Gear springs and dampers by mujoco.sysid; run by `time_domain_rival.py` in its own environment.

``python time_domain_peer.py CASE.json OUT.json`` replays the recorded torques from rest and fits
the motors' angles, Gauss-Newton over rollouts, from every start. Residuals are divided by the
encoders' noise: divided by the angles' own size, as by default, they are so small that its
tolerances end the search far from the minimum.
"""

import json
import sys
import time

import mujoco
import numpy as np
from mujoco import sysid


def prepared(case):
    """Return the model's specification with torque inputs, and the experiments."""
    spec = mujoco.MjSpec.from_string(case["xml"])
    spec.option.timestep = case["sample_time"]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    for motor in case["motors"]:
        actuator = spec.add_actuator(
            name=f"torque {motor['joint']}",
            target=motor["joint"],
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
        )
        actuator.gear = [motor["ratio"], 0, 0, 0, 0, 0]
    model = spec.compile()
    rest = np.zeros(model.nq)
    for motor, joint, angle in zip(case["motors"], case["drives"], case["position"], strict=True):
        for name in (motor["joint"], joint):
            rest[model.joint(name).qposadr[0]] = angle
    start = sysid.create_initial_state(model, rest)
    ratios = np.array([motor["ratio"] for motor in case["motors"]])
    mapping = {
        f"{motor['joint']}_qpos": (sysid.SignalType.MjStateQPos, np.array([i]))
        for i, motor in enumerate(case["motors"])
    }
    controls, sensors = [], []
    for torque, angle in zip(case["torque"], case["angle"], strict=True):
        times = case["sample_time"] * np.arange(len(torque))
        controls.append(sysid.TimeSeries(times, np.array(torque)))
        sensors.append(sysid.TimeSeries(times, np.array(angle) / ratios, mapping))
    names = [f"experiment {i}" for i in range(len(controls))]
    return spec, sysid.ModelSequences(
        "robot", spec, names, [start] * len(names), controls, sensors, allow_missing_sensors=True
    )


def standardised(case):
    """Return a function that compares angles after each step with those measured then."""
    std = case["angle_noise"] / np.abs([motor["ratio"] for motor in case["motors"]])
    joints = [motor["joint"] for motor in case["motors"]]

    def residual(params, predicted, measured, model, return_all, state):
        at = [1 + int(model.joint(name).qposadr[0]) for name in joints]
        apart = (state[:-1, at] - measured.data[1 : len(state)]) / std
        return apart, measured, measured

    return residual


def parameters(case, start):
    """Return ln(theta/truth) as parameters, between bounds, at a start."""
    tendons = {spring["name"]: spring["tendon"] for spring in case["springs"]}
    found = sysid.ParameterDict()
    reach = case["reach"] * np.log(10)
    for name, truth, value in zip(case["names"], case["truth"], start, strict=True):
        spring, kind = name.split(".")

        def modify(spec, parameter, tendon=tendons[spring], kind=kind, truth=truth):
            number = truth * float(np.exp(parameter.value[0]))
            pad = [number, 0.0, 0.0]
            setattr(spec.tendon(tendon), kind, pad)

        parameter = sysid.Parameter(name, 0.0, -reach, reach, modifier=modify)
        found.add(parameter)
        found[name].value[:] = np.log(value / truth)
    return found


def main():
    """Fit from every start."""
    source, target = sys.argv[1:]
    with open(source) as file:
        case = json.load(file)
    _, sequences = prepared(case)
    residual = sysid.build_residual_fn(
        models_sequences=[sequences], modify_residual=standardised(case)
    )
    truth = parameters(case, case["truth"])
    at_truth = np.concatenate(residual(truth.as_vector(), truth)[0])
    values, begun = [], time.perf_counter()
    for start in case["starts"]:
        found, _ = sysid.optimize(parameters(case, start), residual, verbose=False, max_iters=100)
        values.append((np.array(case["truth"]) * np.exp(found.as_vector())).tolist())
    result = {
        "values": values,
        "seconds": time.perf_counter() - begun,
        "residual_at_the_truth": float(np.sqrt(np.mean(at_truth**2))),
        "version": mujoco.__version__,
    }
    with open(target, "w") as file:
        json.dump(result, file)


if __name__ == "__main__":
    main()
