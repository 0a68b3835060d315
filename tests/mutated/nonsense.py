"""Values that no file of an arm should have, in the notations of YAML, JSON and XML."""

from typing import Final

BOMB: Final = "{a: &a [1, 1, 1, 1, 1, 1, 1, 1], b: &b [*a, *a, *a, *a, *a, *a, *a, *a], c: &c [*b, *b, *b, *b, *b, *b]}"

NUMBERS: Final = ("-1", "0", "1e-9", "1e308", "-1e308", "1e999", "9223372036854775808", "-9223372036854775809",
                  "99999999999999999999999999", "1" * 5000, "0x7fffffff", "0b1", "010", "1_0", "1:30", "+5", ".5",
                  "0.1.2", "1,5", "65536", "255", "4096", "3.7", "-0.0", "1e-320", "4e9")  # fmt: skip
NOT_NUMBERS: Final = ("true", "false", "yes", "off", ".nan", ".inf", "-.inf", "nan", "inf", "-inf", "NaN", "Infinity",
                      "null", "~", "''", '""', "' '", "text", "2026-11-26", "2026-11-26T12:00:00Z", "=", "<<", "'1'",
                      '"\\u0000"', '"\\ud800"', '"\\x1b[2J"', '"line\\nline"', "Länge", "机械臂", "../../..",
                      "/dev/null", "/dev/zero", "~/x", "%s", "{}", "[]", "[[]]", "{a: 1}", "[1, two, 3.0, null]",
                      "[" * 60 + "]" * 60, "{? [1]: 2}", "{1: 2}", "{null: 1}", "{true: 1}", "{'': 1}")  # fmt: skip
TAGGED: Final = ("!!bool maybe", "!!int ''", "!!float x", "!!timestamp soon", "!!binary '='", "!!set {a, b}",
                 "!!str 1", "!!omap [a: 1]", "!!pairs [a: 1]", "!!python/object:os.system x", "!own x", "!!null x",
                 "!!map []", "!!seq {}", "!!merge x", "&a [*a]", "*unknown", BOMB, "|\n    text", "@x", "`x", "%x",
                 "- x", "a: b: c", "'open", "[open", "{open", "# nothing",
                 "!<tag:yaml.org,2002:int> 1.5")  # fmt: skip
IN_YAML: Final = NUMBERS + NOT_NUMBERS + TAGGED

IN_XML: Final = (*NUMBERS, "true", "", " ", "nan", "inf", "-inf", "1 2", "1 2 3 4", "nan nan nan",
                 "1e308 1e308 1e308", "0 0 0", "text", "${x}", "$(find x)", "&undefined;", "<", "&#0;", "&#xd800;",
                 "Länge", "机械臂", "\x1b[2J", "\x00", "\n\n", "a" * 3000, "..", "/dev/null", "package://x/y.stl",
                 "joint1", "elbow_flex", "fixed", "continuous", "planar", "world", "base_link", "1e-320",
                 "0 0 1e-320")  # fmt: skip
IN_TEXT: Final = (b"\x00", b"\xff", b"\xfe\xff", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\r\n", b"\t", b"\x1b[2J",
                  b"\x85", b"\xe2\x80\xa8", b"---\n", b"...\n", b"%YAML 1.3\n", b"<<: ", b"*a", b"&a ", b"- ", b": ",
                  b"{", b"}", b"[", b"]", b"'", b'"', b"#", b"<!--", b"<![CDATA[", b"]]>",
                  b"<?xml version='1.0' encoding='x'?>", b"<!DOCTYPE a [<!ENTITY b 'c'>]>", b"&lt;", b"&b;", b"\xc3",
                  b"\xed\xa0\x80")  # fmt: skip
"""Bytes that have a special meaning or are invalid in UTF-8."""
