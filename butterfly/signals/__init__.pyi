from .frequency_response import ResponsePoint as ResponsePoint
from .frequency_response import response_point as response_point
from .resample import uniform_grid as uniform_grid
from .sine_fit import SineFit as SineFit
from .sine_fit import fit_sine as fit_sine
from .window import steady_window as steady_window
