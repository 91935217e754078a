"""What a scene compiles in and leaves out, what it costs, and where its step comes from."""

from collections import defaultdict
from typing import Any

import numpy as np

from taichi_jello.physics.forces._base import Rates
from taichi_jello.run.simulation import Simulation
from taichi_jello.scene.body import FAMILY_NAMES


def facts(simulation: Simulation) -> dict[str, Any]:
    """Everything `jello explain` says, as plain numbers and names."""
    system, body, bound = simulation.system, simulation.body, simulation.system.bound
    fields: dict[str, dict[str, int]] = defaultdict(dict)
    for owner, name, size in system.memory.fields:
        fields[owner][name] = size
    count = np.bincount(body.family, minlength=len(FAMILY_NAMES))
    return {
        "title": simulation.scene.title,
        "arch": system.owner.arch,
        "precision": system.owner.precision,
        "particles": len(body),
        "springs": {name: int(n) for name, n in zip(FAMILY_NAMES, count, strict=True) if n},
        "form": _form(system.team),
        "compiled_in": [force.title for force in system.all_forces]
        + ["sweep"] * len(system.sweeps[:1])
        + [simulation.method]
        + system.particles.traits()
        + system.changes.present,
        "left_out": system.absent
        + ["sweep"] * (not system.sweeps)
        + system.particles.absent_traits()
        + system.changes.absent,
        "fields": dict(fields),
        "bytes": sum(size for *_, size in system.memory.fields),
        "bound": {
            "forces": {
                force.title: {
                    "squared_frequency": rate.squared_frequency,
                    "damping": rate.damping,
                    "damping_time": rate.damping_time if np.isfinite(rate.damping_time) else None,
                }
                for force, rate in zip(system.all_forces, system.rates, strict=True)
            },
            "squared_frequency": bound.squared_frequency,
            "damping": bound.damping,
            "safety": bound.safety,
            "safe_dt": bound.dt if np.isfinite(bound.dt) else None,
            "wild_dt": bound.wild_dt if bound.wild_dt < bound.dt else None,
        },
        "method": simulation.method,
        "automatic": system.integrator.automatic,
        "unseen": _unseen(system),
        "chosen": simulation.choice.reason if simulation.choice else "asked for",
        "dt": simulation.dt,
        "substeps": simulation.substeps,
        "frame_dt": simulation.frame_dt,
        "in_parts_beyond": _in_parts_beyond(simulation),
    }


def _in_parts_beyond(simulation: Simulation) -> float | None:
    """[m] The way by which jellos may come at each other in one step: automatic steps are taken in parts beyond it."""
    if simulation.asked_step != ("auto", None):
        return None
    least = min((force.nearest for force in simulation.system.mutual), default=np.inf)
    return least if np.isfinite(least) else None


def _unseen(system: Any) -> list[str]:
    """The forces that change with place or speed and do not tell an implicit solve how (see ParticleForce)."""
    if not system.integrator.solves:
        return []
    silent = [force for force in system.all_forces if not (force.has_curvature or force.couples)]
    return [force.title for force in silent if force.reads_velocity or force.rates() != Rates()]


def _form(team: int) -> str:
    if not team:
        return "parallel tasks"
    if team == 1:
        return "one loop a frame on one thread"
    return f"one loop a frame shared by {team} threads, fewer while something else keeps them waiting"


def text(told: dict[str, Any]) -> str:
    """The facts as a page to read."""
    bound, safe = told["bound"], told["bound"]["safe_dt"]
    lines = [
        told["title"] or "(untitled)",
        f"  {told['particles']} particles, {sum(told['springs'].values())} springs: "
        + ", ".join(f"{n} {name}" for name, n in told["springs"].items()),
        f"  {told['arch']}, {told['precision']}, {told['form']}",
        f"method: {told['method']}: {told['chosen']}",
        *(f"  {title}: taken where the step ends, its slope unseen by the solve" for title in told["unseen"]),
        "compiled in: " + ", ".join(told["compiled_in"]),
        "left out:    " + (", ".join(told["left_out"]) or "nothing"),
        f"fields: {told['bytes']:,} bytes, {told['bytes'] / told['particles']:.0f} a particle",
    ]
    for owner, fields in told["fields"].items():
        parts = ", ".join(f"{name} {size:,}" for name, size in fields.items())
        lines.append(f"  {owner:22s} {sum(fields.values()):>12,}  ({parts})")
    lines.append("step: every force bounds how fast it can make the particles swing (Λ) and how hard it damps (Γ)")
    for name, rate in bound["forces"].items():
        if rate["squared_frequency"] or rate["damping"]:
            lines.append(f"  {name:22s} Λ = {rate['squared_frequency']:.4g} /s²   Γ = {rate['damping']:.4g} /s")
    lines.append(f"  {'together':22s} Λ = {bound['squared_frequency']:.4g} /s²   Γ = {bound['damping']:.4g} /s")
    endless = (
        "no limit: nothing swings" if not bound["squared_frequency"] else f"no limit: {told['method']} is implicit"
    )
    limit = endless if safe is None else f"safe dt = {safe:.4g} s (safety {bound['safety']:g} included)"
    lines.append(f"  {limit}" + (f"; dt = auto takes {told['automatic']}" if told["automatic"] else ""))
    lines.append(f"  dt = {told['dt']:.4g} s: {told['substeps']} substeps of a {told['frame_dt']:.4g} s frame")
    if bound["wild_dt"]:
        lines.append(f"  dt = auto takes at most {bound['wild_dt']:.4g} s while springs may pass zero length")
    if told["in_parts_beyond"]:
        lines.append(f"  in parts while jellos come at each other by more than {told['in_parts_beyond']:.3g} m a step")
    return "\n".join(lines)
