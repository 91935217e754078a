"""The only place that starts Taichi: arch, precision, threads, and whether fields still belong to it."""

import contextlib
import ctypes
import io
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import taichi as ti
from taichi._lib import core
from taichi.lang import kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

ARCHES = ("cpu", "cuda", "vulkan", "metal", "gpu")
PRECISIONS = ("f32", "f64")


class RuntimeProblem(RuntimeError):
    """The request is impossible on this machine or with this start of Taichi."""


@dataclass(frozen=True)
class Runtime:
    """One `ti.init`. The next one invalidates its fields; `serial` counts the starts."""

    arch: str
    precision: str
    threads: int
    serial: int

    @property
    def on_cpu(self) -> bool:
        return self.arch == "cpu"

    @property
    def epsilon(self) -> float:
        """The rounding unit of this precision."""
        return 2.0**-23 if self.precision == "f32" else 2.0**-52


_current: Runtime | None = None
_workers: dict[int, int] = {}  # the core for each of Taichi's threads
_pinned = False  # whether each is bound to it now


def vulkan_device_types() -> list[int]:
    """VkPhysicalDeviceType of every Vulkan device: 1 integrated, 2 discrete, 3 virtual GPU, 4 CPU. Empty without
    a loader or a driver."""
    names = {"win32": "vulkan-1.dll", "darwin": "libMoltenVK.dylib"}
    try:
        vk = ctypes.CDLL(names.get(sys.platform, "libvulkan.so.1"))
    except OSError:
        return []
    info = (ctypes.c_uint64 * 8)(1)  # VkInstanceCreateInfo: sType 1, the rest 0
    instance = ctypes.c_void_p()
    if vk.vkCreateInstance(info, None, ctypes.byref(instance)) != 0:
        return []
    count = ctypes.c_uint32()
    vk.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None)
    devices = (ctypes.c_void_p * count.value)()
    vk.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), devices)
    types = []
    for device in devices:
        properties = (ctypes.c_uint32 * 1024)()  # VkPhysicalDeviceProperties: deviceType is its fifth word
        vk.vkGetPhysicalDeviceProperties(ctypes.c_void_p(device), properties)
        types.append(int(properties[4]))
    vk.vkDestroyInstance(instance, None)
    return types


def has_vulkan() -> bool:
    """Whether Taichi can use a Vulkan driver, hardware or software. On Linux the loader is checked first, since Taichi
    prints an error without one."""
    return not (sys.platform.startswith("linux") and not vulkan_device_types()) and bool(core.with_vulkan())


def has_real_vulkan() -> bool:
    """Whether there is a Vulkan GPU."""
    return any(kind in (1, 2, 3) for kind in vulkan_device_types())


def _has_cuda() -> bool:
    core.set_logging_level("error")  # no warning about a missing libcuda
    return core.with_cuda()


def choose_arch(name: str) -> str:
    """The arch to start: "gpu" becomes CUDA, Metal or a Vulkan device that is not a software driver.

    Raises RuntimeProblem if this machine has none.
    """
    if name not in ARCHES:
        raise RuntimeProblem(f"--arch: expected one of {', '.join(ARCHES)}, got {name!r}")
    has = {"cpu": lambda: True, "vulkan": has_vulkan, "metal": core.with_metal, "cuda": _has_cuda}
    if name != "gpu":
        if not has[name]():
            raise RuntimeProblem(f"--arch: this machine has no {name} device or driver")
        return name
    for arch in ("cuda", "metal"):
        if has[arch]():
            return arch
    if has_vulkan() and has_real_vulkan():
        return "vulkan"
    raise RuntimeProblem("--arch: this machine has no GPU that Taichi can use (a software Vulkan driver is not one)")


def usable_cores() -> list[int]:
    """The CPU cores that this process may use."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))


def start(arch: str = "cpu", precision: str = "f32", threads: int | None = None) -> Runtime:
    """Start Taichi, which invalidates all earlier fields. Reads no environment but Taichi's own.

    arch: one of ARCHES; precision: "f32" or "f64"; threads: CPU threads, at most and by default all usable cores.
    Raises RuntimeProblem for an invalid argument or an arch that this machine lacks.
    """
    global _current, _pinned
    if precision not in PRECISIONS:
        raise RuntimeProblem(f"--precision: expected f32 or f64, got {precision!r}")
    cores = usable_cores()
    threads = len(cores) if threads is None else min(threads, len(cores))
    if threads < 1:
        raise RuntimeProblem(f"--threads: expected a whole number of at least 1, got {threads}")
    chosen = choose_arch(arch)
    if chosen in ("vulkan", "metal") and precision == "f64":
        raise RuntimeProblem(f"--precision: {chosen} has no f64 here, use f32 or another --arch")
    others = _tasks()
    with contextlib.redirect_stdout(io.StringIO()):  # "[Taichi] Starting on arch=…" has no switch
        ti.init(
            arch=getattr(ti, chosen),
            default_fp=getattr(ti, precision),
            cpu_max_num_threads=threads,
            log_level=ti.ERROR,
            make_cpu_multithreading_loop=False,  # with these two a loop's block_dim may be below 512
            cpu_block_dim_adaptive=False,
            default_cpu_block_dim=512,
            cfg_optimization=False,  # a third of the compile time, the same speed: LLVM optimises anyway
            unrolling_limit=0,  # no warning for scenes with many tables to fill
            fast_math=False,  # it may reorder sums, so serial and parallel kernels would differ
        )
    _workers.clear()
    if chosen == "cpu" and threads == len(cores) > 1:
        _workers.update(zip(sorted(_tasks() - others)[-threads:], cores, strict=False))
    _pinned = False
    settle(True)
    _current = Runtime(chosen, precision, threads, 1 if _current is None else _current.serial + 1)
    return _current


def _tasks() -> set[int]:
    """The threads of this process; empty without /proc."""
    try:
        return {int(number) for number in os.listdir("/proc/self/task")}
    except OSError:
        return set()


def settle(all_at_work: bool) -> None:
    """Pin each of Taichi's workers to a core while all are at work, else free them. Linux sometimes wakes two on one
    core, where one waits for the other's time slice: such frames take ten times as long. Only if there are as many
    threads as cores: with fewer, others may be using the chosen cores."""
    global _pinned
    if all_at_work == _pinned:
        return
    _pinned = all_at_work
    for worker in _workers.keys() & _tasks():
        with contextlib.suppress(OSError):  # the thread may have ended
            os.sched_setaffinity(worker, {_workers[worker]} if all_at_work else set(_workers.values()))


@contextlib.contextmanager
def compiling_in_half_the_time() -> Iterator[None]:
    """Within, kernels are compiled without Taichi's own optimisation, which takes most of the compile time of large
    kernels."""
    config = ti.lang.impl.get_runtime().prog.config()
    before, config.advanced_optimization = config.advanced_optimization, False
    try:
        yield
    finally:
        config.advanced_optimization = before


def current() -> Runtime:
    """The running Taichi, started with its defaults if there is none."""
    return _current if _current is not None else start()


def check(owner: Runtime) -> None:
    """Raise RuntimeProblem if the fields of `owner` are invalid: using them would crash the process."""
    if owner is not _current:
        raise RuntimeProblem("Taichi was started again after this simulation was made; make the simulation anew")


def _position(self: ASTTransformerContext, node: Any) -> str:
    """The position of a node for error messages. Taichi computes it for every node of a kernel; its own version takes a
    third of the time to read a kernel."""
    line = node.lineno + self.lineno_offset
    return f'File "{self.file}", line {line}, in {self.func.func.__name__}:\n{self.src[node.lineno - 1].rstrip()}\n'


ASTTransformerContext.get_pos_info = _position
# Taichi reads and tokenises a function's source again wherever it is inlined.
kernel_impl.getsourcelines = cache(kernel_impl.getsourcelines)
kernel_impl.getsourcefile = cache(kernel_impl.getsourcefile)
