"""The front end's complaints turned into one sentence with file, line and a way around."""

from __future__ import annotations

import re
from collections.abc import Sequence

from hystid.errors import ModelicaError
from hystid.modelica.sources import Source, declaration, near
from hystid.modelica.workarounds.derivatives_of_expressions import NAME as NAMED_DERIVATIVE

_PLACE = re.compile(r"\[([^\[\]\n]+):(\d+):\d+\]")
_QUOTED = re.compile(
    r"(?:unresolved [\w ]+|not found|base class not found|unknown [\w ]+|only be applied to state variables)"
    r":? [`']?([A-Za-z_][\w.\[\]]*)"
)

# Built-in operators outside the subset, with the way around.
REFUSED = {
    "spatialDistribution": "discretise in space with an array of states",
    "terminate": "end the experiment from outside",
    "inStream": "streams are not supported: use plain connectors",
    "actualStream": "streams are not supported: use plain connectors",
    "previous": "use sample(start, interval) and pre()",
    "hold": "use sample(start, interval) and pre()",
    "subSample": "use sample(start, interval) and pre()",
    "cardinality": "state the number of connections by a parameter",
}

# keywords (Modelica specification 3.6, section 2.3.3): none of them is what was meant by a name
_KEYWORDS = """
algorithm and annotation block break class connect connector constant constrainedby der discrete each else elseif
elsewhen encapsulated end enumeration equation expandable extends external false final flow for function if import
impure initial inner input loop model not operator output outer package parameter partial protected public pure
record redeclare replaceable return stream then true type when while within
"""
_NO_NAMES = frozenset((*_KEYWORDS.split(), "time"))
# a keyword where a class or a variable has its name: what may stand there beside a name is left out
_NAMED = re.compile(
    r"\b(?:class|model|block|record|function|package|connector|type|(?:Real|Integer|Boolean|String)(?:\s*\[[^\]]*\])?)\s+("
    + "|".join(sorted({*_KEYWORDS.split()} - {"annotation", "constrainedby", "extends"}))
    + r")\b"
)


def located_syntax_error(said: Sequence[tuple[Source, Sequence[str]]]) -> None:
    """Raise ModelicaError for the first file that does not parse; the line comes out of the message's picture.

    said: what the front end says about each file by itself.
    """
    for source, text in ((source, text) for source, texts in said for text in texts):
        if ": error:" not in text:
            continue
        if taken := _NAMED.search(source.plain):
            where, word = source.place(taken.start(1)), taken.group(1)
            raise ModelicaError(f"{where}: syntax error: '{word}' is a keyword: choose another name")
        place = re.search(r"\[[^\[\]\n]*:(\d+):(\d+)\]", text)
        pictured = re.search(r"×\s*(?:parse error:\s*)?(.+(?:\n\s*│ .+)*)", text)  # long ones go on in the next line
        what = pictured or re.search(
            r": error:\s*(?:parse error:\s*)?(.+?)(?:\s*\(line \d+\))?(?:\s*\[[\w-]+\])?$", text
        )
        named = re.search(r"\(line (\d+)\)", text)
        line = named.group(1) if named else place.group(1) if place else "1"
        core = re.sub(r"\s*\n\s*│\s*", " ", what.group(1)) if what else text
        raise ModelicaError(f"{source.path}:{line}: syntax error: {_plain(core)}")


def explain(message: str, name: str, files: Sequence[Source], library: Sequence[Source]) -> ModelicaError:
    """One sentence for a message of the front end about class ``name``."""
    sources = [*files, *library]
    core = _core(message)
    place = _PLACE.search(message)
    where = f"{place.group(1)}:{place.group(2)}" if place else _search(message, core, name, sources)
    operator = re.search(r"unresolved Flat reference [`'](\w+)[`']", core)
    if operator and operator.group(1) in REFUSED:
        return ModelicaError(f"{where}: {operator.group(1)}() is not supported: {REFUSED[operator.group(1)]}")
    return ModelicaError(f"{where}: {_plain(core)}{_advice(core, sources)}")


def broken_down(message: str, name: str, sources: Sequence[Source]) -> ModelicaError:
    """One sentence for a breakdown inside the front end."""
    offset = re.search(r"BytePos\((\d+)\), end: BytePos\((\d+)\)", message)
    if "derivative target" in message and offset:
        start, end = int(offset.group(1)), int(offset.group(2))
        place = next((f"{s.path}:{s.line(start)}" for s in sources if s.piece(start, end).startswith("der")), name)
        return ModelicaError(
            f"{place}: der() takes a variable that equations determine: the derivative of an input, a parameter "
            "or time is not known; declare it as an input of its own"
        )
    return ModelicaError(
        f"{declared_at(name, sources)}: the front end broke down on this model ({message[:80]}): look for der() or "
        "pre() of what is no variable, or leave parts of the model out to find the line"
    )


def gave_up(how: str, name: str, sources: Sequence[Source]) -> ModelicaError:
    """One sentence for an end of the front end's process without an answer."""
    return ModelicaError(
        f"{declared_at(name, sources)}: the front end gave up on this model ({how}): use smaller arrays and loops, "
        "less deeply nested expressions, or leave parts of the model out to find the line"
    )


def _core(message: str) -> str:
    """The first line without the stage, the wrapper and the place."""
    text = message.splitlines()[0]
    text = re.sub(r"^.*? (?:could not be compiled:|failed in \w+:)\s*", "", text)
    text = re.sub(r"^parse error:\s*", "", text)
    return _PLACE.sub("", text).strip().rstrip(".")


def _search(message: str, core: str, name: str, sources: Sequence[Source]) -> str:
    """File and line by looking for the name that the message speaks of."""
    line = re.search(r"\(line (\d+)\)", core)
    file = re.search(r"^- (.+?) \[", message, re.MULTILINE)
    if line and file and not file.group(1).startswith("<"):
        return f"{file.group(1)}:{line.group(1)}"
    construct = _construct(core, sources)
    if construct:
        return construct
    quoted = _QUOTED.search(core) or re.search(r"[`']([A-Za-z_][\w.\[\]]*)[`']", core)
    if quoted:
        word = re.sub(r"\[.*", "", quoted.group(1))
        for source in sources:
            found = source.find(word)
            if found:
                return f"{source.path}:{found}"
    return declared_at(name, sources)


_OVER_ELEMENTS = r"\bfor\s+\w+\s+in\s+[\w.{}, ]+(?:\bloop\b|[)}])"
# Where the front end names a construct without its line: pattern in its words, pattern of the construct in a text.
_CONSTRUCTS = (
    (r"function loop domain|comprehension domain", _OVER_ELEMENTS),
    (r"escaped its structured owner", r"\b(?:mod|rem|div)\s*\("),
    (r"derivative expression", r"\bder\s*\(\s*(?![\w.\[\], ]+\))"),
    (r"shape mismatch", rf"(?<!Real ){NAMED_DERIVATIVE}"),
    (r"history operator|change\(|edge\(", r"\b(?:change|edge|pre)\s*\(\s*(?![\w.\[\], ]+\))"),
    (r"function (?:statement|return|break|loop)", r"\b(?:while|return|break)\b"),
    (r"external function", r"\bexternal\b"),
    (r"function value type", r"\bextends\s+ExternalObject\b"),
    (r"missing source scope", r"\(\s*,|,\s*,|,\s*\)\s*:?="),
    (r"initial algorithm", r"\binitial\s+algorithm\b"),
    (r"model algorithm", r"(?<!initial )\balgorithm\b"),
    (r"branches have mismatched", r"(?m)^\s*if\b"),
    (r"unbalanced", r"\bstream\b"),
    (
        r"binding type compatibility",
        r"\bBoolean\s+\w+\s*(?:\([^()]*\))?\s*=\s*[-+.\d]|\b(?:Real|Integer)\s+\w+[^=;]*=\s*(?:true|false)\b",
    ),
    (r"found Enumeration", r"(?<![\w.])Integer\s*\("),
    (r"[Cc]lock|previous", r"\b(?:Clock|previous|hold|subSample)\s*\("),
)


def _construct(core: str, sources: Sequence[Source]) -> str:
    for words, pattern in _CONSTRUCTS:
        if not re.search(words, core):
            continue
        for source in sources:
            found = re.search(pattern, source.plain)
            if found:
                return source.place(found.end() - len(found.group().lstrip()))
    return ""


def declared_at(name: str, sources: Sequence[Source]) -> str:
    """File and line of a class's declaration, the class name itself where it is nowhere."""
    return str(declaration(name, sources) or name)


# What to say after the front end's own words, by a pattern in them.
_ADVICE = (
    (r"function loop domain|comprehension domain", "; loops run over numbers: for i in 1:size(v, 1), with v[i]"),
    (
        r"escaped its structured owner",
        "; mod, rem and div of a loop's index make no subscript with a parameter in them: write a constant or "
        "size(v, 1) in its place",
    ),
    (r"conflicting definitions", "; the name is taken by what the class extends: choose another one"),
    (r"unbalanced model", "; give every unknown one equation"),
    (r"derivative expression", "; der() takes one variable: give the expression a name and derive that"),
    (
        r"function (?:statement|return|break|loop)",
        "; functions may hold assignments, if, for and while-loops over numbers: say with 'if' what return or break do",
    ),
    (r"operator '(?:scalar|matrix|vector|symmetric|ndims)'", "; name the elements, A[1, 1], in place of it"),
    (r"function-selection", "; declare the function outside the package that is redeclared with it"),
    (r"external function", "; external functions are not supported: write the function in Modelica"),
    (r"function value type", "; external objects are not supported: write what they do in Modelica"),
    (r"missing source scope", "; give each output of the function a variable, also one that nobody reads"),
    (r"only be applied to state variables", "; reinit() takes a scalar state: name array elements as scalars"),
    (r"history operator|edge\(|change\(", "; give the operand a name: Boolean b = <condition>, then change(b)"),
    (
        r"unevaluable array dimensions|algorithm [`']for[`'] range",
        "; give a number that is known when the model is built, as of a final parameter",
    ),
    (
        r"initial algorithm target",
        "; let it set a parameter p(fixed = false), and say by an initial equation what is equal to p",
    ),
    (r"algorithm", "; write equations, or a function, in place of this algorithm section"),
    (
        r"branches have mismatched equation counts",
        "; every branch of an if-equation needs as many equations, 'else' too",
    ),
    (r"when-equations cannot be nested", "; join the conditions with 'and', or use elsewhen"),
    (r"previous|[Cc]lock", "; clocks are not supported: use sample(start, interval) and pre()"),
    (r"expected Real, found Integer", "; write whole numbers with a decimal point here (1.0)"),
    (r"duplicate discrete", "; a variable is assigned in two when-clauses: join them by elsewhen"),
    (
        r"expression shape mismatch",
        "; a value has another type or size than what it is given to: name an array first, parameter Real v[n] = ...",
    ),
    (
        r"not a discrete coordinate",
        "; a state is set by reinit(x, value); assign an array as a whole, u = {...}, or name its elements as scalars",
    ),
    (r"dependency cycle", "; break the loop with pre(), as in n = pre(n) + 1"),
    (
        r"member augmentation",
        "; this is not supported: declare the member in the connector, expandable connector Bus Real speed; end Bus",
    ),
    (r"equality comparison on Real", "; compare by < or >, or name a Boolean or an Integer that says the same"),
    (r"when-equation LHS", "; write name = expression in a when-clause, solved for what is assigned"),
    (r"found Enumeration", "; write Integer(e), where e is the name of a variable or of a parameter"),
)


def _advice(core: str, sources: Sequence[Source]) -> str:
    if "unbalanced" in core and any(re.search(r"\bstream\b", s.plain) for s in sources):
        return "; stream connectors are not supported: use plain connectors"
    if "mismatch" in core and any(NAMED_DERIVATIVE in s.text for s in sources):
        return "; der() of an array takes its name: if one stands there, declare Real z[n] = ..., and write der(z)"
    unresolved = re.search(r"(?:unresolved [\w ]+|base class not found)[:\s]+[`']([\w.]+)[`']", core)
    if unresolved:
        word = unresolved.group(1)
        if word.startswith("Modelica."):
            if any(re.search(r"\bencapsulated\b", s.plain) for s in sources):
                return "; an encapsulated class sees what it imports alone: import Modelica"
            return (
                "; of the Modelica Standard Library only Units.SI, Constants, Math and Blocks.Interfaces are here: "
                "write the component out, or give its .mo files as a library"
            )
        return near(word, _identifiers(sources) - {word})
    open_size = re.search(r"unresolved component dimension for ([\w.]+)", core)
    if open_size:
        return f"; write the size of '{open_size.group(1)}' in its declaration: it is not taken from a function"
    for pattern, advice in _ADVICE:
        if re.search(pattern, core):
            return advice
    return ""


def _identifiers(sources: Sequence[Source]) -> set[str]:
    return {word for s in sources for word in re.findall(r"[A-Za-z_]\w{2,}", s.plain)} - _NO_NAMES


# Words of a compiler, and those of a Modelica author in their place.
_WORDS = (
    (r".*model algorithm.*", "this algorithm section in a model is not supported"),
    (r"unevaluable array dimensions for (\S+): .*?\[Expression\((.*?)\)\].*", r"the size \2 of \1 is open"),
    (r".*initial algorithm [`']for[`'] range.*", "the range of a loop in an initial algorithm is open"),
    (r".*initial algorithm target ([`'][^`']+[`']) has role.*", r"an initial algorithm sets \1, which is no parameter"),
    (r"unsupported Flat semantic owner ", "not supported: "),
    (r"missing source scope for imports:?", "an output that is left out, as in (, y) = f(x), is not supported"),
    (r".*expected a numeric expression, found Enumeration.*", "an enumeration stands where a number has to"),
    (
        r"invalid Appendix B discrete solved form: [`']([^`']+)[`'] .* dependency cycle",
        r"the value of '\1' depends on itself at one instant",
    ),
    (r"requires unsupported member augmentation", "adds a member that the connector does not declare"),
    (r"; unknowns\[.*", ""),
    (r" in scope [`']*: conditions \[.*", ""),
    (r"Modelica only allows functional call statement as equation.*", "an equation without '=' ('==' compares)"),
    (r"missing source context.*binding type.*", "a variable gets a value of another type, as a Boolean a number"),
    (r"\s*\(line \d+\)", ""),
    ("`", "'"),
    (r"unresolved (?:component|type|import|function)[\w ]*: ('[^']+')", r"\1 is not declared"),
    (r"base class not found: ('[^']+') does not exist", r"there is no class \1"),
)


def _plain(core: str) -> str:
    for words, others in _WORDS:
        core = re.sub(words, others, core)
    return core
