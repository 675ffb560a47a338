"""Lists of jobs: what spreadsheets write is read, and what cannot work is said in one sentence."""

import json
from pathlib import Path

import pytest

from planfit.batch.jobs import Column, Job, Option, read_jobs
from planfit.errors import OptionError

COLUMNS = {
    "unit": Column(),
    "no-plan": Column(is_switch=True),
    "use-masks": Column(is_switch=True, has_no=True),
    "poses": Column(is_file=True),
    "layer": Column(is_repeated=True),
    "adjust.walls.weight": Column(),
}


def jobs_of(tmp_path, text, name="jobs.csv", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return [job for _, job in read_jobs(path, COLUMNS)]


def message_of(tmp_path, text, name="jobs.csv", encoding="utf-8"):
    with pytest.raises(OptionError) as raised:
        jobs_of(tmp_path, text, name, encoding)
    message = str(raised.value)
    assert "\n" not in message
    assert message.startswith(str(tmp_path / name))
    return message.removeprefix(str(tmp_path / name))


def test_cells_become_flags_and_paths_begin_at_the_file(tmp_path):
    (job, other) = jobs_of(
        tmp_path,
        "name,scan,plan,unit,adjust.walls.weight,no_plan,use-masks,poses,layer,memory-gb\n"
        "a,scans/a,plan.pdf,cm,0.03,,no,p.txt,A | B,2.5\n"
        "b,/x/b.zip/office,0=g.pdf|1=s3://b/u.pdf,,,yes,true,,,\n",
    )
    assert job == Job(
        "a",
        str(tmp_path / "scans/a"),
        (str(tmp_path / "plan.pdf"),),
        (
            Option("--unit", ("cm",)),
            Option("--no-use-masks"),
            Option("--poses", (str(tmp_path / "p.txt"),), is_file=True),
            Option("--layer", ("A",)),
            Option("--layer", ("B",)),
            Option("--adjust.walls.weight", ("0.03",)),
        ),
        2.5,
    )
    assert other.scan == "/x/b.zip/office"
    assert other.plans == (f"0={tmp_path / 'g.pdf'}", "1=s3://b/u.pdf")
    assert other.options == (Option("--no-plan"), Option("--use-masks"))


def test_a_value_that_begins_with_a_dash_is_no_flag():
    assert Option("--cloud-up", ("-x",)).words == ["--cloud-up=-x"]
    assert Option("--layer", ("A", "B")).words == ["--layer", "A", "B"]


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_what_spreadsheets_write_is_read(tmp_path, delimiter, encoding, end):
    lines = [["name", "scan", "plan"], ["Büro 1", "Scans/Büro 1", "Plan,neu;1.pdf"], ["", "", ""]]
    text = end.join(
        delimiter.join(f'"{c}"' if set(c) & set(",;") else c for c in line) for line in lines
    )
    (job,) = jobs_of(tmp_path, text, encoding=encoding)
    assert job.name == "Büro 1"
    assert job.scan == str(tmp_path / "Scans/Büro 1")
    assert job.plans == (str(tmp_path / "Plan,neu;1.pdf"),)


def test_the_delimiter_that_excel_names_is_believed(tmp_path):
    (job,) = jobs_of(tmp_path, "sep=;\r\nname;scan\r\na;b,c\r\n")
    assert job.scan == str(tmp_path / "b,c")


def test_toml_and_json_say_the_same_as_csv(tmp_path):
    csv = jobs_of(
        tmp_path,
        "name,scan,plan,adjust.walls.weight,layer,no-plan\na,s,0=p|1=q,0.03,A|B,true\n",
    )
    toml = jobs_of(
        tmp_path,
        '[[jobs]]\nname = "a"\nscan = "s"\nplan = ["0=p", "1=q"]\nadjust.walls.weight = 0.03\n'
        'layer = ["A", "B"]\nno-plan = true\n',
        "jobs.toml",
    )
    values = {
        "name": "a",
        "scan": "s",
        "plan": ["0=p", "1=q"],
        "layer": ["A", "B"],
        "no-plan": True,
    }
    values["adjust"] = {"walls": {"weight": 0.03}}
    text = json.dumps([values])
    assert csv == toml == jobs_of(tmp_path, text, "jobs.json")
    assert csv == jobs_of(tmp_path, json.dumps({"jobs": [values]}), "jobs.json")


@pytest.mark.parametrize("address", ["s3://b/k", "https://h/s.zip", "zip://a::https://h/s.zip"])
def test_addresses_stay_as_they_are(tmp_path, address):
    (job,) = jobs_of(tmp_path, f"name,scan,plan,poses\na,{address},{address},{address}\n")
    assert (job.scan, job.plans, job.options[0].values) == (address, (address,), (address,))


def test_a_windows_path_is_no_address(tmp_path):
    (job,) = jobs_of(tmp_path, "name,scan\na,C:\\scans\\a\n")
    assert job.scan.endswith("C:\\scans\\a")
    assert job.scan != "C:\\scans\\a"  # here, on another system, it is a relative path


BAD = {
    "": "expected a line a job below the names of the columns",
    "name,scan\n": "found no job",
    "scan,plan\na,b\n": "expected a column 'name', found 'plan', 'scan'",
    "name,plan\na,b\n": "expected a column 'scan'",
    "name,scan\na,b\n,c\n": ", line 3: expected a name, found none",
    "name,scan,unti\na,b,m\n": "found the column 'unti'; did you mean unit?",
    "name,scan,walls.weight\na,b,1\n": "found the column 'walls.weight'; did you mean adjust.walls.weight?",
    "name,scan,xyzzy\na,b,1\n": "see planfit refine --help-all",
    "name,scan\na,b\nA,c\n": "line 3: expected a name that no other job has, found 'A', which is the name in "
    "line 2",
    "name,scan,scan\na,b,c\n": "expected each column once, found scan more than once",
    "name,scan\na,b,c\n": "line 2: expected 2 cells, as there are columns, found 3",
    "name,scan\na,x|y\n": "line 2: expected one scan, found 2: x, y",
    "name,scan\na/b,c\n": "expected a name that can be that of a folder",
    "name,scan\n..,c\n": "expected a name that can be that of a folder",
    "name,scan\nNUL,c\n": "expected a name that can be that of a folder",
    "name,scan\nBatch,c\n": "expected another name than 'Batch'",
    "name,scan,no-plan\na,b,maybe\n": "expected true or false as no-plan, found 'maybe'",
    "name,scan,memory-gb\na,b,much\n": "expected gigabytes as memory-gb, as 4.5, found 'much'",
    "name,scan,memory-gb\na,b,0\n": "expected gigabytes",
    'name,scan\na,"b\n': "look for a quote that is not closed",
}


@pytest.mark.parametrize("text", BAD, ids=lambda text: text.replace("\n", "/") or "empty")
def test_a_bad_list_is_said_in_one_sentence(tmp_path, text):
    assert BAD[text] in message_of(tmp_path, text)


def test_other_encodings_are_not_guessed(tmp_path):
    said = message_of(tmp_path, "name,scan\nBüro,s\n", encoding="cp1252")
    assert "expected text in UTF-8" in said
    assert "CSV UTF-8" in said


def test_bad_data_files(tmp_path):
    assert "expected TOML" in message_of(tmp_path, "[[jobs", "jobs.toml")
    assert "write [[jobs]] above each" in message_of(tmp_path, "a = 1", "jobs.toml")
    assert '{"jobs": [' in message_of(tmp_path, "[1]", "jobs.json")
    assert "expected text, numbers" in message_of(
        tmp_path, '[{"name": "a", "scan": "b", "unit": [{}]}]', "jobs.json"
    )
    both = '{"name": "a", "scan": "b", "adjust": {"x": 1}, "adjust.x": 2}'
    assert "expected each option once" in message_of(tmp_path, f"[{both}]", "jobs.json")


def test_a_missing_list(tmp_path: Path):
    with pytest.raises(OptionError, match="expected a file of jobs"):
        read_jobs(tmp_path / "none.csv", COLUMNS)
