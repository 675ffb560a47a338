"""What every part runs on: parallel, cached work; threads; files written whole; mapped rows; options by name.

Knows nothing of scans and plans. Run folders are in `planfit.runtime.run_folder`, which takes locks: their
library (filelock) is loaded only where there is a folder to lock.
"""

from planfit.runtime.archives import archive_of as archive_of
from planfit.runtime.archives import leads_out as leads_out
from planfit.runtime.archives import path_inside as path_inside
from planfit.runtime.archives import require_content as require_content
from planfit.runtime.archives import unpacked as unpacked
from planfit.runtime.cache_chunks import Arrays as Arrays
from planfit.runtime.cache_chunks import StoredArray as StoredArray
from planfit.runtime.cache_chunks import StoredItem as StoredItem
from planfit.runtime.learned_models import find_weights as find_weights
from planfit.runtime.learned_models import first_line as first_line
from planfit.runtime.learned_models import load_model as load_model
from planfit.runtime.mapped import ROWS_AT_A_TIME as ROWS_AT_A_TIME
from planfit.runtime.mapped import changed as changed
from planfit.runtime.mapped import concatenated as concatenated
from planfit.runtime.mapped import for_kernels as for_kernels
from planfit.runtime.mapped import let_go as let_go
from planfit.runtime.mapped import map_rows as map_rows
from planfit.runtime.mapped import row_parts as row_parts
from planfit.runtime.mapped import taken as taken
from planfit.runtime.option_values import Changeable as Changeable
from planfit.runtime.option_values import kind_words as kind_words
from planfit.runtime.option_values import options_of as options_of
from planfit.runtime.option_values import require_kinds as require_kinds
from planfit.runtime.option_values import whole_number as whole_number
from planfit.runtime.parallel import SEED as SEED
from planfit.runtime.parallel import ProgressLine as ProgressLine
from planfit.runtime.parallel import Runtime as Runtime
from planfit.runtime.parallel import StageTimer as StageTimer
from planfit.runtime.parallel import cache_key as cache_key
from planfit.runtime.parallel import give_back_memory as give_back_memory
from planfit.runtime.short_repr import html_table as html_table
from planfit.runtime.short_repr import short_html as short_html
from planfit.runtime.short_repr import short_repr as short_repr
from planfit.runtime.threads import blas_on_one_thread as blas_on_one_thread
from planfit.runtime.threads import in_threads as in_threads
from planfit.runtime.whole_files import made_folder as made_folder
from planfit.runtime.whole_files import whole_file as whole_file
from planfit.runtime.whole_files import whole_folder as whole_folder
from planfit.runtime.whole_files import write_whole as write_whole
