"""A config is the plug-in's signature: what fits is built, what does not is named."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal, final

import pytest

from wideberth.framework.plugins import registry
from wideberth.framework.plugins.config import build, describe, import_plugins
from wideberth.framework.plugins.registry import ROOMS, register
from wideberth.framework.plugins.yamlfile import apply, dump, parse, read_config
from wideberth.framework.predictor import Adaptive, Predictor
from wideberth.framework.values.arrays import Array, positive
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks


class Shade(StrEnum):
    DARK = "dark"
    LIGHT = "light"


@dataclass(frozen=True)
class Limits:
    top: float = 1.0
    names: tuple[str, ...] = ()


@final
@dataclass(frozen=True)
class Every(Predictor):
    """A predictor with a field of every kind."""

    needed: float
    count: int = 1
    on: bool = True
    pair: tuple[float, float] = (0.0, 1.0)
    mode: Literal["a", "b"] = "a"
    shade: Shade = Shade.DARK
    file: Path | None = None
    limits: Limits = Limits()
    more: tuple[Limits, ...] = ()
    table: Mapping[str, float] = field(default_factory=dict)
    inner: Predictor | None = None
    list_of: tuple[Predictor, ...] = ()
    named: Mapping[str, Predictor] = field(default_factory=dict)
    start: Annotated[Predictor | None, "noted"] = None
    adaptive: Adaptive | None = None
    either: Limits | float = 0.0
    array: Array | None = None
    hidden: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        positive("needed", self.needed)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        raise NotImplementedError


@final
@dataclass(frozen=True)
class Leaf(Predictor):
    size: float = 2.0
    tail: float = 0.1

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        raise NotImplementedError


@final
@dataclass(frozen=True)
class Bare(Predictor):
    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        raise NotImplementedError


@final
@dataclass(frozen=True)
class Holder(Predictor):
    leaf: Predictor = Leaf(3.0)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        raise NotImplementedError


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_registered", {room: {} for room in ROOMS})
    for name, kind in (("every", Every), ("leaf", Leaf), ("holder", Holder), ("bare", Bare)):
        register("predictors", name)(kind)


FULL: dict[str, Any] = {
    "type": "every", "needed": 1, "count": 2, "on": False, "pair": [1, 2.5], "mode": "b",
    "shade": "light", "file": "a/b.txt", "limits": {"top": 3}, "more": [{"names": ["x"]}, {}],
    "table": {"k": 1}, "inner": "leaf", "list_of": ["leaf", {"type": "leaf", "size": 9}],
    "named": {"n": "leaf"}, "start": "leaf", "either": {"top": 4},
}  # fmt: skip


def test_builds_every_kind_of_field() -> None:
    made = build("predictors", FULL)
    assert made == Every(
        1.0, 2, False, (1.0, 2.5), "b", Shade.LIGHT, Path("a/b.txt"), Limits(3.0),
        (Limits(names=("x",)), Limits()), {"k": 1.0}, Leaf(), (Leaf(), Leaf(9.0)),
        {"n": Leaf()}, Leaf(), None, Limits(4.0),
    )  # fmt: skip
    assert type(made.needed) is float and type(made.pair[0]) is float
    assert build("predictor" + "s", made) is made


def test_describe_and_build_are_inverse() -> None:
    made = build("predictors", FULL)
    config = describe(made)
    assert list(config)[:2] == ["type", "needed"] and config["limits"]["names"] == []
    assert "hidden" not in config
    assert build("predictors", parse(dump(config), "dump")) == made


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"neded": 1}, r"^p: unknown key 'neded': did you mean 'needed'\? Known: adaptive"),
        ({"needed": "1"}, r"^p\.needed: came '1' \(str\); wanted float"),
        ({"needed": None}, r"^p\.needed: came None"),
        ({"needed": -1}, r"^p: needed is -1; wanted a finite number above 0"),
        ({"count": 1.5}, r"^p\.count: came 1.5 \(float\); wanted int"),
        ({"count": True}, r"^p\.count: came True \(bool\); wanted int"),
        ({"needed": True}, r"^p\.needed: came True"),
        ({"on": 1}, r"^p\.on: came 1 \(int\); wanted bool"),
        ({"pair": [1]}, r"^p\.pair"),
        ({"pair": [1, "x"]}, r"^p\.pair\.1: came 'x'"),
        ({"mode": "c"}, r"^p\.mode: came 'c' .*'a' or 'b'"),
        ({"shade": "grey"}, r"^p\.shade: came 'grey' .*'dark' or 'light'"),
        ({"limits": {"tpo": 1}}, r"^p\.limits: unknown key 'tpo': did you mean 'top'"),
        ({"limits": 3}, r"^p\.limits: came 3 .*mapping with the fields of Limits"),
        ({"more": [{}, {"top": "x"}]}, r"^p\.more\.1\.top: came 'x'"),
        ({"more": {}}, r"^p\.more: came \{\} .*a list"),
        ({"inner": "leav"}, r"^p\.inner\.type: unknown predictor 'leav': did you mean 'leaf'"),
        ({"inner": 3}, r"^p\.inner: came 3 \(int\); wanted the name of a predictor"),
        ({"inner": {"size": 1}}, r"^p\.inner: key 'type' is missing; wanted one of:"),
        ({"inner": {"type": "leaf", "sise": 1}}, r"^p\.inner: unknown key 'sise'"),
        ({"inner": {"type": "bare", "x": 1}}, r"^p\.inner: unknown .*x.: Bare takes no keys$"),
        ({"list_of": "leaf"}, r"^p\.list_of: came 'leaf' .*a list"),
        ({"named": {"n": "leav"}}, r"^p\.named\.n\.type: unknown"),
        ({"named": ["leaf"]}, r"^p\.named: came .*a mapping"),
        ({"adaptive": "leaf"}, r"^p\.adaptive: came 'leaf' .*wanted a Adaptive"),
        ({"either": "x"}, r"^p\.either.*; or p\.either"),
        ({"array": [1.0]}, r"^p\.array: a config cannot set .*use Python"),
        ({"hidden": 1}, r"^p: unknown key 'hidden'"),
        ({"type": 3}, r"^p: key 'type' is missing; wanted"),
        ({"inner": {"typ": "leaf"}}, r"^p\.inner: key 'type' is missing \(is it meant by 'typ'"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        build("predictors", {"type": "every", "needed": 1.0, **change}, "p")


def test_missing_key_and_wrong_root() -> None:
    with pytest.raises(WideberthError, match=r"^key 'needed' is missing; it has no default"):
        build("predictors", "every")
    with pytest.raises(WideberthError, match=r"^came \[\] \(list\); wanted the name of a predic"):
        build("predictors", [])


@final
@dataclass(frozen=True)
class Careless(Predictor):
    inner: Predictor = "leaf"  # type: ignore[assignment]

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        raise NotImplementedError


def test_a_default_that_only_names_a_plug_in_is_refused() -> None:
    wanted = r"^p: the default of Careless\.inner is the text 'leaf'; wanted a Predictor, as in "
    with pytest.raises(WideberthError, match=wanted):
        build("predictors", {"type": f"{__name__}:Careless"}, "p")
    assert build("predictors", {"type": f"{__name__}:Careless", "inner": "leaf"}) == Careless(
        Leaf()
    )


def test_settings_without_a_type_change_the_default() -> None:
    assert build("predictors", {"type": "holder", "leaf": {"tail": 0.5}}) == Holder(Leaf(3.0, 0.5))


@pytest.mark.parametrize("room", sorted({*ROOMS} - {"experiments", "slot_kinds"}))
def test_every_built_in_survives_describe(room: str) -> None:
    for name in registry._built_in(room):
        survives_describe(room, name)


def survives_describe(room: str, name: str) -> None:
    if (room, name) == ("controllers", "mpc"):
        value: Any = {
            "type": "mpc", "robot": "unicycle", "region": "mahalanobis_ellipse",
            "predictor": "constant_velocity", "level": "relaxed", "solver": "ipopt",
        }  # fmt: skip
    elif (room, name) == ("controllers", "policy"):
        value = {"type": name, "robot": "unicycle", "policy": "math:sqrt"}
    elif room == "controllers" and name in ("around_crowds", "withdrawing"):
        value = {"type": name, "controller": {"type": "pure_pursuit", "robot": "unicycle"}}
    elif room == "controllers":
        value = {"type": name, "robot": "unicycle"}
    elif name == "recorded_scene":
        value = {"type": name, "scene": "zara1", "tracks": "."}
    elif name == "scan_matching":
        value = {"type": name, "walls": [{"vertices": [[0, 0], [8, 0], [8, 0.2], [0, 0.2]]}]}
    else:
        value = name
    made = build(room, value)
    config = describe(made)
    again = build(room, parse(dump(config), "dump"))
    assert describe(again) == config and config["type"] == name
    # Controllers are the same only if they are one, and so are scenarios with people in them.
    if type(made).__eq__ is not object.__eq__ and room != "scenarios":
        assert again == made


def test_yaml_numbers_and_duplicates() -> None:
    assert parse("a: 1e-3\nb: -.inf\nc: 1.5\nd: 2\ne: 1e3x", "t") == {
        "a": 1e-3, "b": float("-inf"), "c": 1.5, "d": 2, "e": "1e3x",
    }  # fmt: skip
    with pytest.raises(WideberthError, match=r"t, line 2, column 1.*'a' stands twice"):
        parse("a: 1\na: 2", "t")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"- a\n- b\n", "is a list; a config is a mapping"),
        (b"", "is empty; a config is a mapping"),
        (b"just text", "is a str; a config is a mapping"),
        (b"\x89PNG\r\n\x1a\n\xff\xfe", "is not text; wanted a YAML file"),
        (b"a: [1,\n", "line 2, column 1 is not YAML"),
        (b"a: 1\nb: \x00", r"line 2, column 4 is not YAML: the character U\+0000 is not allowed"),
        (b"a: {b: 1\nc: 2\n", r"line 2, column 2 is not YAML.* that begins in line 1, column 4$"),
        (b"a: 1\n\tb: 2", "line 2, column 1 is not YAML: a tab stands here; indent with blanks$"),
        (b"a: b: c", "line 1, column 5 is not YAML: a key cannot stand here; is its line indent"),
        (
            b"a: 1\nb\nc: 2",
            "line 3, column 1 is not YAML: a line without ':' where a key",
        ),
        (b"a: 'b", "line 1, column 6 is not YAML: the text ends; is a quotation mark left open"),
        (b"a: *b", "line 1, column 4 is not YAML: found undefined alias"),
        (b"a: &b [*b]", "line 1, column 4 is not YAML: this holds an alias to itself"),
    ],
)
def test_unreadable_configs(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "c.yaml"
    path.write_bytes(content)
    with pytest.raises(WideberthError, match=f"c.yaml.*{message}"):
        read_config(path)
    with pytest.raises(WideberthError, match=r"cannot be read: No such file"):
        read_config(tmp_path / "none.yaml")
    with pytest.raises(WideberthError, match=r"cannot be read: Is a directory"):
        read_config(tmp_path)


def test_overrides(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text("inner: leaf\nlist_of: [leaf, leaf]\nneeded: 1\n")
    changes = ["inner.size=1e-1", "list_of.1.size=7", "limits.top=2", "pair=[1, 2]", "mode=b"]
    config = read_config(path, changes)
    made = build("predictors", {"type": "every", **config})
    assert (made.inner, made.list_of) == (Leaf(0.1), (Leaf(), Leaf(7.0)))
    assert (made.limits, made.pair, made.mode) == (Limits(2.0), (1.0, 2.0), "b")


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("a", "wanted KEY=VALUE"),
        ("=1", "wanted KEY=VALUE"),
        ("a..b=1", "wanted KEY=VALUE"),
        ("number.x=1", "number is 1, which has no keys"),
        ("list.5=1", "list is a list of 1; '5' is no index"),
        ("a=[", "is not YAML"),
    ],
)
def test_overrides_that_do_not_fit(override: str, message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        apply({"number": 1, "list": [0]}, override)


def test_plugins_are_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "plug_in_of_a_test.py").write_text("value = 1\n")
    (tmp_path / "torn_plug_in.py").write_text("1 / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    import_plugins(["plug_in_of_a_test"])
    assert sys.modules.pop("plug_in_of_a_test").value == 1
    with pytest.raises(WideberthError, match=r"'torn_plug_in' cannot be imported .ZeroDivision"):
        import_plugins(["torn_plug_in"])
    for wrong in ("x", 3, {"x": 1}, [3]):
        with pytest.raises(WideberthError, match=r"plugins is .*; wanted a list"):
            import_plugins(wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a:\t0.5", {"a": 0.5}),
        ("a: 0.5\t# m", {"a": 0.5}),
        ("a: 0.5 \t \nb:\t\n  c: 1\t\n", {"a": 0.5, "b": {"c": 1}}),
        ("a\t:\t&x 3\nb:\t*x", {"a": 3, "b": 3}),
        ("a: two\twords\t", {"a": "two\twords"}),
        ("a: two\t\n  words", {"a": "two words"}),
        ("-\t3\n- 4\t", [3, 4]),
        ("a: 1\n\t\n \t# by hand\nb: 2", {"a": 1, "b": 2}),
        ("a: [1,\t2\t,\n\t3]\t# three", {"a": [1, 2, 3]}),
        ("{a:\t1\t,\tb: 2\t}", {"a": 1, "b": 2}),
        ("a: '\tx'", {"a": "\tx"}),
    ],
)
def test_tabs_separate(text: str, value: object) -> None:
    assert parse(text, "c") == value


@pytest.mark.parametrize("text", ["a:\n\tb: 1", "\ta: 1", "a: 1\n  \tb: 2", "-\t- 1", "-\ta: 1"])
def test_tabs_do_not_indent(text: str) -> None:
    with pytest.raises(WideberthError, match="is not YAML"):
        parse(text, "c")


def test_a_line_of_tabs_is_read_in_one_go() -> None:
    blanks = "\t " * 100_000
    assert parse(f"a:{blanks}1\n{blanks}\nb: [1,{blanks}2]{blanks}", "c") == {"a": 1, "b": [1, 2]}


@pytest.mark.parametrize("text", ["010", "-007", "00", "0_7", "1_000", "1_000.5", "1:30", "1:30.5",
                                  "190:20:30", "0b101", "1e-400", "-.5E-999"])  # fmt: skip
def test_numbers_that_readers_of_yaml_take_for_others_are_refused(text: str) -> None:
    for config in (f"limit: {text}", f"limits: [1, {text}]", f"{text}: 1"):
        with pytest.raises(WideberthError, match=r"line 1, .* (readers of YAML|too small)"):
            parse(config, "c")
    assert parse(f"limit: '{text}'", "c") == {"limit": text}


@pytest.mark.parametrize(("text", "value"), [("0", 0), ("0.0", 0.0), ("07.5", 7.5), ("0x1F", 31),
                                             ("0e-999", 0.0), ("1e-310", 1e-310)])  # fmt: skip
def test_plain_numbers_are_read(text: str, value: float) -> None:
    assert parse(f"limit: {text}", "c") == {"limit": value}


@pytest.mark.parametrize(
    "text", ["1e5", ".5e3", "1e-400", "1E400", "010", "1:30", "12", "a\tb", "yes"]
)
def test_text_that_looks_like_a_number_stays_text(text: str) -> None:
    assert parse(dump({"name": text}), "c") == {"name": text}
