/* Functions of complex numbers that Wine 8 has by name alone; NumPy asks for them. */
#include <math.h>

typedef struct {
    double re, im;
} Complex;

static Complex complex(double re, double im) { return (Complex){re, im}; }

static Complex times(Complex a, Complex b) {
    return complex(a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re);
}

static Complex over(Complex a, Complex b) {
    double squared = b.re * b.re + b.im * b.im;
    Complex product = times(a, complex(b.re, -b.im));
    return complex(product.re / squared, product.im / squared);
}

Complex own_cexp(Complex z) {
    double size = exp(z.re);
    return z.im == 0 ? complex(size, z.im) : complex(size * cos(z.im), size * sin(z.im));
}

Complex own_clog(Complex z) { return complex(log(hypot(z.re, z.im)), atan2(z.im, z.re)); }

Complex own_cpow(Complex base, Complex power) {
    if (base.re == 0 && base.im == 0) return complex(power.re == 0 && power.im == 0, 0);
    return own_cexp(times(power, own_clog(base)));
}

Complex own_csqrt(Complex z) {
    double size = hypot(z.re, z.im);
    return complex(sqrt((size + z.re) / 2), copysign(sqrt((size - z.re) / 2), z.im));
}

Complex own_csin(Complex z) { return complex(sin(z.re) * cosh(z.im), cos(z.re) * sinh(z.im)); }
Complex own_ccos(Complex z) { return complex(cos(z.re) * cosh(z.im), -sin(z.re) * sinh(z.im)); }
Complex own_csinh(Complex z) { return complex(sinh(z.re) * cos(z.im), cosh(z.re) * sin(z.im)); }
Complex own_ccosh(Complex z) { return complex(cosh(z.re) * cos(z.im), sinh(z.re) * sin(z.im)); }
Complex own_ctan(Complex z) { return over(own_csin(z), own_ccos(z)); }
Complex own_ctanh(Complex z) { return over(own_csinh(z), own_ccosh(z)); }
