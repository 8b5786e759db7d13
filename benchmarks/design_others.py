"""Run the peers of `design.py`, each in a process of its own, with a limit of processor time."""

import signal
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from linearisation import HERE, peer_python

import oed
from oed.design.coordinates import whiten
from robotmodels.common.arrays import Array

SIZES = (1_000, 7_920, 20_000)
LIMIT = 70  # s of processor time, for starting, a small design and the one that is timed
PACKAGES = ("figaroh==1.0.2", "pydex==0.0.9", "cvxpy", "clarabel", "scs")
# Who takes more than the limit for 7 920 candidates is not asked for 20 000. figaroh needs memory
# with the square of the candidates: 5.4 GB for 1 000.
PEERS = {
    "cvxpy dual, SCS": SIZES,
    "cvxpy primal, Clarabel": SIZES,
    "cvxpy dual, Clarabel": SIZES,
    "pydex": SIZES,
    "figaroh": (300, 1_000),
}


def peer_times(info: oed.InformationSet, sizes: tuple[int, ...]) -> dict[str, Any]:
    """Return each peer's time and the gap of its weights, certified like our own.

    A peer that takes longer than the limit is not asked for more candidates.
    """
    python, result = peer_python("design", PACKAGES), {}
    white = whiten(info.matrices, info.total / len(info))
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "matrices.npy"), Path(folder, "out.npz")
        for peer, counts in PEERS.items():
            for n in (n for n in counts if n <= max(sizes)):
                np.save(source, white[:n])
                found = one_peer(python, peer, source, target, white[:n])
                result[f"{peer}, {n}"] = found
                print(f"  {peer}, {n}: {found}", flush=True)
                if "limit" in found:
                    break
    return result


def one_peer(python: Path, peer: str, source: Path, target: Path, white: Array) -> dict[str, Any]:
    """Run one peer in its own process."""
    command = [python, HERE / "design_peers.py", peer, source, target, str(LIMIT)]
    run = subprocess.run(command, check=False, capture_output=True)
    if run.returncode == -signal.SIGXCPU:
        return {"limit": f"{LIMIT} s"}
    if run.returncode:
        lines = run.stderr.decode(errors="replace").strip().splitlines()
        return {"failed": lines[-1][:200] if lines else f"exit code {run.returncode}"}
    with np.load(target) as out:
        weights = np.maximum(out["weights"], 0.0)
        times = {name: float(out[name]) for name in ("seconds", "cpu_seconds")}
    return times | {"gap": oed.optimality_gap(weights, white)}
