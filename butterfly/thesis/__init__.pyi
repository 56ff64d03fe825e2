from .method import Thesis as Thesis
from .resonance import complex_fit as complex_fit
from .resonance_regression import fit_ratio as fit_ratio
from .scripts import fit_thesis as fit_thesis
from .tables import reproduce as reproduce
