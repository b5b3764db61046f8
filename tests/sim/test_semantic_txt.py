"""HM3D's semantic text file: its lines are read, and every mistake is refused with its line number."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.errors import SceneError
from sim.scans.semantic_txt import SemanticLabel, read_semantic_txt

HEADER = "HM3D Semantic Annotations\n"


def written(tmp_path, text: str | bytes):
    path = tmp_path / "a.semantic.txt"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_lines_are_read_with_commas_in_categories_and_gaps_between_ids(tmp_path):
    text = HEADER + '1,FF00aa,"wall",0\n\n70,000001,"shelf, with books, ""old""",-1\r\n65535,00FF00,"",12\n'
    assert read_semantic_txt(written(tmp_path, text)) == (
        SemanticLabel(1, 0xFF00AA, "wall", 0),
        SemanticLabel(70, 1, 'shelf, with books, ""old""', -1),
        SemanticLabel(65535, 0xFF00, "", 12),
    )
    assert read_semantic_txt(written(tmp_path, HEADER)) == ()


@pytest.mark.parametrize(
    ("text", "line", "expected"),
    [
        ("", 1, "found ''; expected 'HM3D Semantic Annotations'"),
        ('1,FF0000,"wall",0\n', 1, "expected 'HM3D Semantic Annotations'"),
        (HEADER + '1,FF0000,"wall",0\nnonsense\n', 3, "found 'nonsense'; expected `id,RRGGBB,\"category\",region`"),
        (HEADER + '1,FF000,"wall",0\n', 2, "expected `id,RRGGBB"),
        (HEADER + '1,FF0000,wall,0\n', 2, "expected `id,RRGGBB"),
        (HEADER + '1,FF0000,"wall"\n', 2, "expected `id,RRGGBB"),
        (HEADER + '-1,FF0000,"wall",0\n', 2, "expected `id,RRGGBB"),
        (HEADER + '1,FF0000,"wall",x\n', 2, "expected `id,RRGGBB"),
        (HEADER + "9" * 100000 + ',FF0000,"wall",0\n', 2, "expected `id,RRGGBB"),
        (HEADER + '0,FF0000,"wall",0\n', 2, "found the id 0; expected 1 to 65535"),
        (HEADER + '65536,FF0000,"wall",0\n', 2, "found the id 65536; expected 1 to 65535"),
        (HEADER + '1,FF0000,"a",0\n1,00FF00,"b",0\n', 3, "found the id of line 2 again; expected another id"),
        (HEADER.encode() + b'1,FF0000,"\xff",0\n', 2, "byte 36 is not UTF-8; expected UTF-8 text"),
    ],
)  # fmt: skip
def test_a_mistake_is_refused_with_its_line_number(tmp_path, text, line, expected):
    path = written(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        read_semantic_txt(path)
    message = str(caught.value)
    assert message.startswith(f"{path}, line {line}: ")
    assert expected in message
    assert "\n" not in message
    assert len(message) < len(str(path)) + 250


def test_a_file_that_is_missing_or_too_large_is_refused(tmp_path):
    with pytest.raises(SceneError, match="cannot be read"):
        read_semantic_txt(tmp_path / "none.txt")
    with (tmp_path / "a.txt").open("wb") as file:
        file.truncate(1 << 30)
    with pytest.raises(SceneError, match="line 1: found the file has 1073741824 bytes; expected at most 16777216"):
        read_semantic_txt(tmp_path / "a.txt")


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("text") / "a.txt"
    path.write_bytes(HEADER.encode() + content)
    try:
        labels = read_semantic_txt(path)
    except SceneError as error:
        labels = ()
        assert "\n" not in str(error)  # noqa: PT017 - most files are refused, some are not
    assert len({label.id for label in labels}) == len(labels)
