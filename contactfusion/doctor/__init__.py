"""What the doctor looks at: packages, system libraries, plug-ins, networks, compiled kernels."""
