"""What a scene compiles in and leaves out, what it costs, and what determines its step."""

from collections import defaultdict
from typing import Any

import numpy as np

from taichi_jello.physics.forces._base import Rates
from taichi_jello.physics.system import System
from taichi_jello.run.simulation import AUTOMATIC, Simulation
from taichi_jello.scene.body import FAMILY_NAMES


def facts(simulation: Simulation) -> dict[str, Any]:
    """The contents of `jello explain` as plain numbers and names."""
    system, body = simulation.system, simulation.body
    fields: dict[str, dict[str, int]] = defaultdict(dict)
    for owner, name, size in system.memory.fields:
        fields[owner][name] = size
    count = np.bincount(body.family, minlength=len(FAMILY_NAMES))
    sweep, no_sweep = ["sweep"] * bool(system.sweeps), ["sweep"] * (not system.sweeps)
    forces = [force.title for force in system.all_forces]
    changes, traits = system.changes, system.particles.traits()
    # With automatic steps, jellos that approach by more than this [m] a step make the step be taken in parts.
    nearest = min((force.nearest for force in system.mutual), default=np.inf)
    in_parts = simulation.asked_step == AUTOMATIC and np.isfinite(nearest)
    return {
        "title": simulation.scene.title,
        "arch": system.owner.arch,
        "precision": system.owner.precision,
        "particles": len(body),
        "springs": {name: int(n) for name, n in zip(FAMILY_NAMES, count, strict=True) if n},
        "form": _form(system.team),
        "compiled_in": [*forces, *sweep, simulation.method, *traits, *changes.present],
        "left_out": [*system.absent, *no_sweep, *system.particles.absent_traits(), *changes.absent],
        "fields": dict(fields),
        "bytes": sum(size for *_, size in system.memory.fields),
        "bound": _bound(system),
        "method": simulation.method,
        "automatic": system.integrator.automatic,
        "unseen": _unseen(system),
        "chosen": simulation.choice.reason if simulation.choice else "given",
        "dt": simulation.dt,
        "substeps": simulation.substeps,
        "frame_dt": simulation.frame_dt,
        "in_parts_beyond": nearest if in_parts else None,
    }


def _bound(system: System) -> dict[str, Any]:
    """What each force contributes to the safe step, and the sum."""
    bound = system.bound
    forces = {
        force.title: {
            "squared_frequency": rate.squared_frequency,
            "damping": rate.damping,
            "damping_time": rate.damping_time if np.isfinite(rate.damping_time) else None,
        }
        for force, rate in zip(system.all_forces, system.rates, strict=True)
    }
    return {
        "forces": forces,
        "squared_frequency": bound.squared_frequency,
        "damping": bound.damping,
        "safety": bound.safety,
        "safe_dt": bound.dt if np.isfinite(bound.dt) else None,
        "wild_dt": bound.wild_dt if bound.wild_dt < bound.dt else None,
    }


def _unseen(system: System) -> list[str]:
    """The forces that vary with position or velocity but give an implicit solve no derivative (see ParticleForce)."""
    silent = [f for f in system.all_forces if system.integrator.solves and not (f.has_curvature or f.couples)]
    return [force.title for force in silent if force.reads_velocity or force.rates() != Rates()]


def _form(team: int) -> str:
    if team < 2:
        return "one loop a frame on one thread" if team else "parallel tasks"
    return f"one loop a frame shared by {team} threads, fewer while something else keeps them waiting"


def text(found: dict[str, Any]) -> str:
    """The facts as a page to read."""
    bound, safe, method = found["bound"], found["bound"]["safe_dt"], found["method"]
    lines = [
        found["title"] or "(untitled)",
        f"  {found['particles']} particles, {sum(found['springs'].values())} springs: "
        + ", ".join(f"{n} {name}" for name, n in found["springs"].items()),
        f"  {found['arch']}, {found['precision']}, {found['form']}",
        f"method: {method}: {found['chosen']}",
        *(f"  {title}: taken where the step ends, its slope unseen by the solve" for title in found["unseen"]),
        "compiled in: " + ", ".join(found["compiled_in"]),
        "left out:    " + (", ".join(found["left_out"]) or "nothing"),
        f"fields: {found['bytes']:,} bytes, {found['bytes'] / found['particles']:.0f} a particle",
    ]
    for owner, fields in found["fields"].items():
        parts = ", ".join(f"{name} {size:,}" for name, size in fields.items())
        lines.append(f"  {owner:22s} {sum(fields.values()):>12,}  ({parts})")
    lines.append("step: every force bounds how fast it can make the particles swing (Λ) and how hard it damps (Γ)")
    for name, rate in [*bound["forces"].items(), ("together", bound)]:
        if rate is bound or rate["squared_frequency"] or rate["damping"]:
            lines.append(f"  {name:22s} Λ = {rate['squared_frequency']:.4g} /s²   Γ = {rate['damping']:.4g} /s")
    limit = f"safe dt = {safe:.4g} s (safety {bound['safety']:g} included)" if safe is not None else "no limit: "
    if safe is None:
        limit += f"{method} is implicit" if bound["squared_frequency"] else "nothing swings"
    lines.append(f"  {limit}" + (f"; dt = auto takes {found['automatic']}" if found["automatic"] else ""))
    lines.append(f"  dt = {found['dt']:.4g} s: {found['substeps']} substeps of a {found['frame_dt']:.4g} s frame")
    if bound["wild_dt"]:
        lines.append(f"  dt = auto takes at most {bound['wild_dt']:.4g} s while springs may pass zero length")
    if approach := found["in_parts_beyond"]:
        lines.append(f"  in parts while jellos approach each other by more than {approach:.3g} m a step")
    return "\n".join(lines)
