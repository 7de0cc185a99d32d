"""Mutations of the Python code, drawn by mutmut, all behind its switch at run time."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import libcst as cst
from chosen import NAME, Entry
from mutant import Area, Mutant, area_of, changed_lines, joined, numbered
from mutmut.mutation.file_mutation import Mutation, combine_mutations_to_source, create_mutations
from mutmut.mutation.trampoline_templates import mangle_function_name
from scratch import Scratch

# what the changed modules import in the place of mutmut's own switch
SWITCH = '''"""The switch of mutmut, which notes what is reached where the one in Rust does."""

import os

import mutmut.mutation.trampoline as _trampoline
from mutmut.mutation.trampoline import MutantDict, wrap_in_trampoline

REACHED = set()


def _note(name, caller=None):
    if name not in REACHED:
        REACHED.add(name)
        with open(os.environ["ZIVI_REACHED"], "a", encoding="utf-8") as file:
            file.write(name + "\\n")


_trampoline.record_trampoline_hit = _note
'''
WRITTEN = {"python/zivi/_mutants.py"}
# texts that nobody reads twice: the wording of messages is not what the tests hold
MESSAGES = ("warn", "Error", "Warning")
# what has statements in it: the change is shown within the part below
ROOMY = (cst.IndentedBlock, cst.Module, cst.BaseCompoundStatement)


class Source:
    """The mutations of one file."""

    def __init__(self, area: str | None, file: str, text: str, entries: Sequence[Entry] = ()):
        self.area, self.file = area, file
        self.name = ".".join(Path(file).with_suffix("").parts[1:]).removesuffix(".__init__")
        self.module, mutations, *self.ignored = create_mutations(file, text)
        self.owner = {
            item: statement.name.value
            for statement in self.module.body
            if isinstance(statement, cst.ClassDef)
            for item in statement.body.body
        }
        self.parents = {child: node for node in every(self.module) for child in node.children}
        wording = {id(node) for node in walk(self.module, inside=False)}
        chosen = [
            mutation
            for mutation in mutations
            if isinstance(mutation.contained_by_top_level_function, cst.FunctionDef)
            and id(mutation.original_node) not in wording
        ]
        drawn = numbered(self.mutant(mutation) for mutation in chosen) if area else []
        self.mutations = dict(zip(drawn, chosen, strict=False))
        for entry in entries:
            self.mutations |= self.chosen(entry, text)

    def functions(self, module: cst.Module) -> list[tuple[str, cst.FunctionDef]]:
        """List the functions and methods that the switch can have: not those with decorators."""
        found = [("", node) for node in module.body]
        for node in module.body:
            if isinstance(node, cst.ClassDef):
                found += [(f"{node.name.value}.", inside) for inside in node.body.body]
        return [
            (owner + node.name.value, node)
            for owner, node in found
            if isinstance(node, cst.FunctionDef) and not node.decorators
        ]

    def chosen(self, entry: Entry, text: str) -> dict[Mutant, Mutation]:
        """Make the mutation that an entry of the list describes."""
        changed = cst.parse_module(text.replace(entry.find, entry.replace))
        pairs = zip(self.functions(self.module), self.functions(changed), strict=True)
        for (name, old), (_, new) in pairs:
            if not old.body.deep_equals(new.body):
                start = text.index(entry.find)
                lines = changed_lines(text, start, start + len(entry.find), entry.replace)
                mutant = Mutant(NAME, self.file, name, *lines, 0, 0, "")
                return {mutant: Mutation(old.body, new.body, old)}
        return {}

    def mutant(self, mutation: Mutation) -> Mutant:
        """Make a mutant of a mutation of mutmut."""
        function = mutation.contained_by_top_level_function
        owner = self.owner.get(function)
        node = mutation.original_node
        while not isinstance(self.parents[node], ROOMY):
            node = self.parents[node]
        new = node.deep_replace(mutation.original_node, mutation.mutated_node)
        before, after = (joined(self.module.code_for_node(code)) for code in (node, new))
        name = f"{owner}.{function.name.value}" if owner else function.name.value
        return Mutant(self.area, self.file, name, before, after, 0, 0, "")

    def switched(self, mutants: Sequence[Mutant]) -> tuple[str, dict[Mutant, str]]:
        """Put `mutants` behind the switch: the text of the file, and how each is called there."""
        made = combine_mutations_to_source(
            self.module, [self.mutations[mutant] for mutant in mutants], *self.ignored
        )
        names = {}
        counts: dict[str, int] = defaultdict(int)
        for mutant in mutants:
            mangled = self.mangled(mutant)
            counts[mangled] += 1
            names[mutant] = f"{mangled}__mutmut_{counts[mangled]}"
        assert sorted(names.values()) == sorted(f"{self.name}.{name}" for name in made.mutant_names)
        return made.code.replace("mutmut.mutation.trampoline", "zivi._mutants"), names

    def mangled(self, mutant: Mutant) -> str:
        """Name the function of `mutant` as mutmut does."""
        owner, _, name = mutant.function.rpartition(".")
        return f"{self.name}.{mangle_function_name(name=name, class_name=owner or None)}"


def every(node: cst.CSTNode) -> Iterator[cst.CSTNode]:
    """Give `node` and all below it."""
    yield node
    for child in node.children:
        yield from every(child)


def walk(node: cst.CSTNode, *, inside: bool) -> Iterator[cst.CSTNode]:
    """Give the nodes that are inside of a message: of `raise`, of a warning."""
    inside = inside or isinstance(node, cst.Raise)
    if isinstance(node, cst.Call):
        name = node.func.attr if isinstance(node.func, cst.Attribute) else node.func
        inside = inside or (isinstance(name, cst.Name) and name.value.endswith(MESSAGES))
    if inside:
        yield node
    for child in node.children:
        yield from walk(child, inside=inside)


class Switched:
    """The mutations of the Python files of some areas, and their copy behind the switch."""

    def __init__(self, root: Path, areas: Sequence[Area], entries: Sequence[Entry]):
        found = {path for area in areas for pattern in area.files for path in root.glob(pattern)}
        files = {path.relative_to(root).as_posix() for path in found}
        files |= {entry.file for entry in entries}
        self.sources = {}
        for file in sorted(file for file in files if file.endswith(".py")):
            text = (root / file).read_text(encoding="utf-8")
            inside = [entry for entry in entries if entry.file == file]
            self.sources[file] = Source(area_of(file, root, areas), file, text, inside)
        self.names: dict[Mutant, str] = {}
        self.places: dict[str, str] = {}

    def reached(self) -> dict[str, set[str]]:
        """Give the places that each name stands for in the log of the switch."""
        return {name: {place} for name, place in self.places.items()}

    @property
    def mutants(self) -> list[Mutant]:
        """Every mutation."""
        return [mutant for source in self.sources.values() for mutant in source.mutations]

    def write(self, scratch: Scratch, mutants: Sequence[Mutant]) -> None:
        """Write the files with `mutants` behind the switch."""
        scratch.put(scratch.tree / "python/zivi/_mutants.py", SWITCH)
        by_file = defaultdict(list)
        for mutant in mutants:
            by_file[mutant.file].append(mutant)
            self.places[self.sources[mutant.file].mangled(mutant)] = mutant.place
        for file, inside in by_file.items():
            text, names = self.sources[file].switched(inside)
            self.names |= names
            scratch.put(scratch.tree / file, text)
