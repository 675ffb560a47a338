"""The benchmark: the paper's terms and strategies on synthetic and real scans, compared scan by scan."""

from planfit.bench.measure import Case as Case
from planfit.bench.measure import load_case as load_case
from planfit.bench.page import make_page as make_page
from planfit.bench.page import write_page as write_page
from planfit.bench.results import Measured as Measured
from planfit.bench.results import Results as Results
from planfit.bench.results import read_results as read_results
from planfit.bench.run import BenchOptions as BenchOptions
from planfit.bench.run import run_bench as run_bench
from planfit.bench.scans import BenchScan as BenchScan
from planfit.bench.scans import paper_scans as paper_scans
from planfit.bench.scans import small_scans as small_scans
from planfit.bench.variants import VARIANTS as VARIANTS
from planfit.bench.variants import Variant as Variant
