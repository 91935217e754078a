"""Find modules and classes in a folder, so a new plugin is one new file."""

from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType
from typing import Any


def modules(package: ModuleType) -> list[ModuleType]:
    """Every module of `package` whose name does not start with an underscore, in alphabetical order."""
    names = sorted(m.name for m in iter_modules(package.__path__) if not m.name.startswith("_"))
    return [import_module(f"{package.__name__}.{name}") for name in names]


def below(package: ModuleType) -> list[ModuleType]:
    """Also the modules of its subfolders, in alphabetical order of their last names."""
    found = modules(package)
    found += [each for one in found if hasattr(one, "__path__") for each in below(one)]
    return sorted(found, key=lambda module: module.__name__.rpartition(".")[2])


def classes(package: ModuleType, base: type) -> list[Any]:
    """Every subclass of `base` defined (not merely imported) in a module below `package`."""
    return [
        member
        for module in below(package)
        for member in vars(module).values()
        if isinstance(member, type)
        and issubclass(member, base)
        and member is not base
        and member.__module__ == module.__name__
    ]
