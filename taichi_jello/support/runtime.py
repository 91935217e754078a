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
    """This machine or this Taichi start cannot do what was asked."""


@dataclass(frozen=True)
class Runtime:
    """One `ti.init`. Fields made under it die with the next one; `serial` tells the starts apart."""

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
_workers: dict[int, int] = {}  # the core that each of Taichi's threads gets
_settled = False  # whether each has it now


def vulkan_device_types() -> list[int]:
    """VkPhysicalDeviceType of every Vulkan device: 1 integrated, 2 discrete, 3 virtual GPU, 4 CPU. Empty without
    a loader or a driver."""
    names = {"win32": "vulkan-1.dll", "darwin": "libMoltenVK.dylib"}
    try:
        vk = ctypes.CDLL(names.get(sys.platform, "libvulkan.so.1"))
    except OSError:
        return []
    # VkInstanceCreateInfo without layers, extensions or application info: sType 1 and zeroes.
    info = (ctypes.c_uint64 * 8)(1)
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
    """Whether Taichi can use a Vulkan driver here, hardware or software. Asked first on Linux: the loader itself,
    since Taichi prints an error of its own where there is none."""
    if sys.platform.startswith("linux") and not vulkan_device_types():
        return False
    return bool(core.with_vulkan())


def has_real_vulkan() -> bool:
    return any(kind in (1, 2, 3) for kind in vulkan_device_types())


def choose_arch(wanted: str) -> str:
    """The arch to start: "gpu" becomes CUDA, Metal or a Vulkan device that is not a software driver.

    Raises RuntimeProblem when this machine has no such arch.
    """
    if wanted not in ARCHES:
        raise RuntimeProblem(f"--arch: expected one of {', '.join(ARCHES)}, got {wanted!r}")
    has = {"cpu": lambda: True, "vulkan": has_vulkan, "metal": core.with_metal, "cuda": _has_cuda}
    if wanted != "gpu":
        if not has[wanted]():
            raise RuntimeProblem(f"--arch: this machine has no {wanted} device or driver")
        return wanted
    for arch in ("cuda", "metal"):
        if has[arch]():
            return arch
    if has_vulkan() and has_real_vulkan():
        return "vulkan"
    raise RuntimeProblem("--arch: this machine has no GPU that Taichi can use (a software Vulkan driver is not one)")


def _has_cuda() -> bool:
    core.set_logging_level("error")  # Taichi warns about a missing libcuda where there is simply no CUDA
    return core.with_cuda()


def usable_cores() -> list[int]:
    """The numbers of the CPU cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def start(arch: str = "cpu", precision: str = "f32", threads: int | None = None) -> Runtime:
    """Start Taichi anew; every field made before is dead. Reads no environment but Taichi's own.

    arch: one of ARCHES; precision: "f32" or "f64"; threads: CPU threads, at most and by default all that this process
    may use.
    Raises RuntimeProblem for a name or a number that cannot be, or an arch that this machine lacks.
    """
    global _current, _settled
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
            make_cpu_multithreading_loop=False,  # these two give one thread 512 iterations at least,
            cpu_block_dim_adaptive=False,  # whatever block_dim a loop asks for
            default_cpu_block_dim=512,  # for the loops that ask for none
            cfg_optimization=False,  # a third of the compile time, the same speed: LLVM optimises anyway
            unrolling_limit=0,  # no warning where a scene has many tables to fill
            fast_math=False,  # it may reorder sums, which gave other bits in a serial than in a parallel kernel
        )
    _workers.clear()
    if chosen == "cpu" and threads == len(cores) > 1:
        _workers.update(zip(sorted(_tasks() - others)[-threads:], cores, strict=False))
    _settled = False
    settle(True)
    _current = Runtime(chosen, precision, threads, 1 if _current is None else _current.serial + 1)
    return _current


def _tasks() -> set[int]:
    """The threads of this process; none where there is no /proc."""
    try:
        return {int(number) for number in os.listdir("/proc/self/task")}
    except OSError:
        return set()


def settle(all_at_work: bool) -> None:
    """Give each of Taichi's workers, which are the threads it starts last, a core of its own while all are at work, or
    else any core. Linux now and then wakes two on one core, where each waits for the other until its time slice is
    over: single frames take ten times as long. Fewer are better off where nothing else runs. Not for fewer threads
    than there are cores, since others may be using just those that would be chosen."""
    global _settled
    if all_at_work == _settled:
        return
    _settled = all_at_work
    for worker in _workers.keys() & _tasks():
        with contextlib.suppress(OSError):  # a thread that has ended since
            os.sched_setaffinity(worker, {_workers[worker]} if all_at_work else set(_workers.values()))


@contextlib.contextmanager
def compiling_in_half_the_time() -> Iterator[None]:
    """What is compiled within is without Taichi's own optimisation before LLVM's, which for every value that it finds
    twice looks through the whole kernel: for large kernels most of the time that compiling takes."""
    config = ti.lang.impl.get_runtime().prog.config()
    config.advanced_optimization = False
    try:
        yield
    finally:
        config.advanced_optimization = True


def current() -> Runtime:
    """The running Taichi; started with its defaults when nobody has."""
    return _current if _current is not None else start()


def check(owner: Runtime) -> None:
    """Raise RuntimeProblem if fields made under `owner` are dead: using them would end the process."""
    if owner is not _current:
        raise RuntimeProblem("Taichi was started again after this simulation was made; make the simulation anew")


def _position(self: ASTTransformerContext, node: Any) -> str:
    """Where a node of a kernel's source stands. Taichi asks this of every node, for messages that are hardly ever
    printed, and by itself wraps and underlines the text each time: a third of the time it needs to read a kernel."""
    line = node.lineno + self.lineno_offset
    return f'File "{self.file}", line {line}, in {self.func.func.__name__}:\n{self.src[node.lineno - 1].rstrip()}\n'


ASTTransformerContext.get_pos_info = _position
# Taichi reads and tokenises a function's source file again wherever the function is inlined.
kernel_impl.getsourcelines = cache(kernel_impl.getsourcelines)
kernel_impl.getsourcefile = cache(kernel_impl.getsourcefile)
