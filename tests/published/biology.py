"""Published models from systems biology, epidemiology, pharmacology and bioprocess engineering, with their observable dimension.

Unknown constant parameters are states with zero rate. An input that enters nonlinearly in the paper is a state whose rate is
the input. Logarithms and real powers want a positive point. Every dimension was computed for this collection from the time series
of the outputs and their sensitivities, exactly modulo a prime or with rigorous balls; `source` says how the paper, or another
author's analysis of the model, compares where that is known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

import obsdesign as od

from .case import Case


def _symbols(names: str) -> list[ca.SX]:
    """One scalar symbol for each word."""
    return [ca.SX.sym(name) for name in names.split()]


def _words(text: str) -> tuple[str, ...]:
    """The words of a text."""
    return tuple(text.split())


def _system(
    states: Sequence[ca.SX],
    rates: Sequence[object],
    parameters: Sequence[ca.SX] = (),
    outputs: Sequence[ca.SX] = (),
    known: Mapping[str, Sequence[object]] | None = None,
    unknown: Mapping[str, Sequence[object]] | None = None,
) -> od.ControlAffineSystem:
    """The system with the parameters behind the states; fields are given for the states alone."""
    every = [*states, *parameters]

    def field(values: Sequence[object]) -> ca.SX:
        assert len(values) == len(states)
        return ca.vertcat(*values, *[0] * len(parameters))

    return od.ControlAffineSystem(
        state=ca.vertcat(*every),
        names=tuple(symbol.name() for symbol in every),
        drift=field(rates),
        known={name: field(values) for name, values in (known or {}).items()},
        unknown={name: field(values) for name, values in (unknown or {}).items()},
        outputs={f"output_{i}": expression for i, expression in enumerate(outputs, 1)},
    )


# ---------------------------------------------------------------- populations


def lotka_volterra() -> od.ControlAffineSystem:
    """Predator and prey; the prey's rate is a sum, the predator's a product of the same two parameters."""
    states = x1, x2 = _symbols("x1 x2")
    parameters = a, b, c, d = _symbols("a b c d")
    return _system(states, [(a + b) * x1 - c * x1 * x2, -a * b * x2 + d * x1 * x2], parameters, [x1])


def three_species_lotka_volterra() -> od.ControlAffineSystem:
    """Three species, two of them counted."""
    states = x = _symbols("x1 x2 x3")
    r = _symbols("r1 r2 r3")
    b = [_symbols(f"b{i}1 b{i}2 b{i}3") for i in (1, 2, 3)]
    rates = [x[i] * (r[i] + sum(b[i][j] * x[j] for j in range(3))) for i in range(3)]
    return _system(states, rates, [*r, *b[0], *b[1], *b[2]], x[:2])


# ---------------------------------------------------------------- epidemics


def compositional_lotka_volterra() -> od.ControlAffineSystem:
    """Proportions of three species under a known perturbation; the third is what the two measured ones leave."""
    states = x1, x2 = _symbols("x1 x2")
    x = [x1, x2, 1 - x1 - x2]
    g, b = _symbols("g1 g2 g3"), _symbols("b1 b2 b3")
    a = [_symbols(f"a{i}1 a{i}2 a{i}3") for i in (1, 2, 3)]
    growth = [g[i] + sum(a[i][j] * x[j] for j in range(3)) for i in range(3)]
    mean, push = sum(x[i] * growth[i] for i in range(3)), sum(x[i] * b[i] for i in range(3))
    known = {"u": [x[i] * (b[i] - push) for i in range(2)]}
    return _system(states, [x[i] * (growth[i] - mean) for i in range(2)], [*g, *a[0], *a[1], *a[2], *b], states, known=known)


def cholera() -> od.ControlAffineSystem:
    """SIWR: infection from people and from water, a share of the cases reported."""
    states = S, In, W, R = _symbols("S I W R")
    parameters = mu, bi, bw, a, gamma, xi, k = _symbols("mu bi bw a gamma xi k")
    infection = bi * S * In + bw * S * W
    rates = [mu - infection - mu * S + a * R, infection - (gamma + mu) * In, xi * (In - W), gamma * In - (mu + a) * R]
    return _system(states, rates, parameters, [k * In])


def seaijrc() -> od.ControlAffineSystem:
    """Covid with asymptomatic, infectious, hospitalised; cumulative cases and the population are known."""
    states = S, E, A, In, J, C, Ninv = _symbols("S E A I J C Ninv")
    parameters = b, q, k, r, g1, alpha, g2 = _symbols("b q k r g1 alpha g2")
    infection = b * S * (In + J + q * A) * Ninv
    rates = [
        -infection,
        infection - k * E,
        k * (1 - r) * E - g1 * A,
        k * r * E - (alpha + g1) * In,
        alpha * In - g2 * J,
        alpha * In,
        0,
    ]
    return _system(states, rates, parameters, [C, Ninv])


def forced_sirs() -> od.ControlAffineSystem:
    """SIRS with a season of unknown frequency."""
    states = s, i, r, c1, c2 = _symbols("s i r c1 c2")
    parameters = mu, b0, b1, g, nu, M = _symbols("mu b0 b1 g nu M")
    infection = b0 * (1 + b1 * c1) * i * s
    rates = [mu - mu * s - infection + g * r, infection - (nu + mu) * i, nu * i - (mu + g) * r, -M * c2, M * c1]
    return _system(states, rates, parameters, [i, r])


def sliqr() -> od.ControlAffineSystem:
    """Latent, infectious, quarantined; a known vaccination rate removes susceptibles."""
    states = S, L, In, Q = _symbols("S L I Q")
    parameters = b, a, g, s, e, Ninv = _symbols("b a g s e Ninv")
    infection = b * In * S * Ninv
    rates = [-infection, infection - a * L, a * L - g * In + s * Q, (1 - e) * g * In - s * Q]
    return _system(states, rates, parameters, [In * Ninv], known={"u": [-S * Ninv, 0, 0, 0]})


def treatment() -> od.ControlAffineSystem:
    """SIR with a treated class; the treated and the population are counted."""
    states = S, In, T, N = _symbols("S I T N")
    parameters = b, d, a, g, nu = _symbols("b d a g nu")
    infection = b * S * (In + d * T) / N
    return _system(states, [-infection, infection - (a + g) * In, g * In - nu * T, 0], parameters, [T, N])


def seir_births() -> od.ControlAffineSystem:
    """SEIR with births and deaths, a share of the infectious reported; population and births are known."""
    states = A, S, E, In = _symbols("A S E I")
    parameters = r, beta, mu, epsilon, gamma, K, N = _symbols("r beta mu epsilon gamma K N")
    infection = r * beta * S * In / N
    rates = [0, A - infection - mu * S, infection - (epsilon + mu) * E, epsilon * E - (gamma + mu) * In]
    return _system(states, rates, parameters, [K * In, A, N])


def seir_detected() -> od.ControlAffineSystem:
    """SEIR with detected exposed and infectious and the dead; six quantities known."""
    states = S, E, In, De, Di, F = _symbols("S E I De Di F")
    parameters = beta, beta_d, q, nu, mu_0, s, phi_e, gamma, mu_i, phi, s_d, gamma_d, mu_d, N = _symbols(
        "beta beta_d q nu mu_0 s phi_e gamma mu_i phi s_d gamma_d mu_d N"
    )
    infection = beta * S * In / N + q * beta_d * S * Di / N
    rates = [
        -infection + nu * N - mu_0 * S,
        infection - (s + phi_e + mu_0) * E,
        s * E - (gamma + mu_i + phi + mu_0) * In,
        phi_e * E - (s_d + mu_0) * De,
        phi * In + s_d * De - (gamma_d + mu_d + mu_0) * Di,
        mu_i * In + mu_d * Di,
    ]
    return _system(states, rates, parameters, [De, Di, F, N, nu, q])


def quarantine_isolation() -> od.ControlAffineSystem:
    """Six classes with births; quarantined and isolated counted."""
    states = S, In, A, Q, J, R = _symbols("S I A Q J R")
    parameters = b, rate, ea, eq, ej, d1, k1, g1, m2, d2, m1, d4, k2, d5, g2, d6, d3 = _symbols(
        "b l ea eq ej d1 k1 g1 m2 d2 m1 d4 k2 d5 g2 d6 d3"
    )
    infection = S * rate * (In + ea * eq * Q + ea * A + ej * J)
    rates = [
        b * (S + In + A + Q + J + R) - infection - d1 * S,
        k1 * A - (g1 + m2 + d2) * In,
        infection - (k1 + m1 + d4) * A,
        m1 * A - (k2 + d5) * Q,
        k2 * Q + m2 * In - (g2 + d6) * J,
        g1 * In + g2 * J - d3 * R,
    ]
    return _system(states, rates, parameters, [Q, J])


def hospital_deaths() -> od.ControlAffineSystem:
    """Exposed, asymptomatic, infectious, hospitalised; only the dead counted."""
    states = A, In, H, R, D, E = _symbols("A I H R D E")
    parameters = a, r1, s, h, r2, r3, d, c1, c2, N = _symbols("a r1 s h r2 r3 d c1 c2 N")
    rates = [
        a * E - r1 * A,
        s * E - (h + r2) * In,
        h * In - (r3 + d) * H,
        r1 * A + r2 * In + r3 * H,
        d * H,
        (N - A - In - H - R - D - E) * (c1 * A + c2 * In) - (a + s) * E,
    ]
    return _system(states, rates, parameters, [D])


def sidarthe() -> od.ControlAffineSystem:
    """Eight stages; diagnosed, recognised, threatened and dead counted."""
    states = S, In, D, A, R, T, _, E = _symbols("S I D A R T H E")
    parameters = al, be, ga, de, ep, th, ze, et, mu, nu, ta, la, rh, ka, xi, si = _symbols(
        "alpha beta gamma delta epsilon theta zeta eta mu nu tau lambda rho kappa xi sigma"
    )
    infection = S * (al * In + be * D + ga * A + de * R)
    rates = [
        -infection,
        infection - (ep + ze + la) * In,
        ep * In - (et + rh) * D,
        ze * In - (th + mu + ka) * A,
        et * D + th * A - (nu + xi) * R,
        mu * A + nu * R - (si + ta) * T,
        la * In + rh * D + ka * A + xi * R + si * T,
        ta * T,
    ]
    return _system(states, rates, parameters, [D, R, T, E])


# ---------------------------------------------------------------- viruses, immunity, tumours


def hiv_immune_control() -> od.ControlAffineSystem:
    """Target cells, infected cells, virus and two kinds of CTL; the CTL counted."""
    states = x, y, v, w, z = _symbols("x y v w z")
    parameters = lm, d, beta, a, k, u, c, q, b, h = _symbols("lm d beta a k u c q b h")
    rates = [
        lm - d * x - beta * x * v,
        beta * x * v - a * y,
        k * y - u * v,
        c * x * y * w - c * q * y * w - b * w,
        c * q * y * w - h * z,
    ]
    return _system(states, rates, parameters, [w, z])


def hiv_latent() -> od.ControlAffineSystem:
    """Target, latently and productively infected cells and virus; target cells and virus counted."""
    states = x1, x2, x3, x4 = _symbols("x1 x2 x3 x4")
    parameters = b, d, s, q1, q2, k1, k2, w1, w2, c = _symbols("b d s q1 q2 k1 k2 w1 w2 c")
    rates = [s - d * x1 - b * x1 * x4, b * q1 * x1 * x4 - (k1 + w1) * x2, b * q2 * x1 * x4 + k1 * x2 - w2 * x3, k2 * x3 - c * x4]
    return _system(states, rates, parameters, [x1, x4])


def _hiv_time_varying(is_known: bool) -> od.ControlAffineSystem:
    states = Tu, Ti, V = _symbols("Tu Ti V")
    parameters = lam, rho, N, delta, c = _symbols("lambda rho N delta c")
    infection = {"eta": [-Tu * V, Tu * V, 0]}
    rates = [lam - rho * Tu, -delta * Ti, N * delta * Ti - c * V]
    given = {"known": infection} if is_known else {"unknown": infection}
    return _system(states, rates, parameters, [V, Tu + Ti], **given)


def hiv_known_infection_rate() -> od.ControlAffineSystem:
    """Virus and all target cells counted, the infection rate varies in a known way."""
    return _hiv_time_varying(True)


def hiv_unknown_infection_rate() -> od.ControlAffineSystem:
    """Virus and all target cells counted, the infection rate varies as it likes."""
    return _hiv_time_varying(False)


def cd8_t_cells() -> od.ControlAffineSystem:
    """Naive, early and late effector and memory cells with the pathogen; the two effectors seen together."""
    states = N, E, S, M, P = _symbols("N E S M P")
    parameters = mu_N, delta_NE, mu_EE, delta_EL, rho_E, delta_LM, mu_LL, mu_LE, mu_M, rho_P, mu_P, mu_PE, mu_PL = _symbols(
        "mu_N delta_NE mu_EE delta_EL rho_E delta_LM mu_LL mu_LE mu_M rho_P mu_P mu_PE mu_PL"
    )
    rates = [
        -mu_N * N - delta_NE * N * P,
        delta_NE * N * P - mu_EE * E**2 - delta_EL * E + rho_E * E * P,
        delta_EL * S - delta_LM * S - mu_LL * S**2 - mu_LE * E * S,
        delta_LM * S - mu_M * M,
        rho_P * P**2 - mu_P * P - mu_PE * E * P - mu_PL * S * P,
    ]
    return _system(states, rates, parameters, [N, E + S, M])


def car_t_leukaemia() -> od.ControlAffineSystem:
    """CAR T cells against leukaemia; CAR T, leukaemic and all B cells counted."""
    states = C, L, B, P, In = _symbols("C L B P I")
    parameters = rhoc, rhob, tauc, rhol, alpha, taui, taub, rhop, ap, ks, taup, rhoi, ai, beta = _symbols(
        "rhoc rhob tauc rhol alpha taui taub rhop ap ks taup rhoi ai beta"
    )
    signal = 1 / (1 + ks * (P + In))
    rates = [
        rhoc * (L + B) * C + rhob * In * C - C / tauc,
        rhol * L - alpha * L * C,
        In / taui - alpha * B * C - B / taub,
        rhop * (2 * ap * signal - 1) * P - P / taup,
        rhoi * (2 * ai * signal - 1) * In - In / taui + P / taup - alpha * beta * In * C,
    ]
    return _system(states, rates, parameters, [C, L, P + B + In])


def pancreatic_tumour() -> od.ControlAffineSystem:
    """Cancer, stellate and effector cells and two cytokines; the effector cells counted."""
    states = x, y, z, w, v = _symbols("x y z w v")
    parameters = r1, b1, d1, m1, r2, b2, k2, mu2, b3, k3, m3, mu3, r3, b4, k4, mu4, r4, m4, b5, k5, mu5 = _symbols(
        "r1 b1 d1 m1 r2 b2 k2 mu2 b3 k3 m3 mu3 r3 b4 k4 mu4 r4 m4 b5 k5 mu5"
    )
    rates = [
        (r1 + b1 * y) * x * (1 - b1 * x) - d1 * x * z / (m1 + w),
        (r2 + b2 * w / (k2 + w)) * y * (1 - b2 * y) - mu2 * y,
        b3 * z * v / ((k3 + v) * (m3 + w)) - mu3 * z + r3,
        b4 * x * z / (k4 + x) - mu4 * w + r4 * x * y / (m4 + v),
        b5 * x * z / (k5 + x) - mu5 * v,
    ]
    return _system(states, rates, parameters, [z])


def chemo_immunotherapy() -> od.ControlAffineSystem:
    """Tumour under chemotherapy, interleukin and given lymphocytes, all known; effector cells, killer cells and the drug measured."""
    states = T, L, N, C, In, M = _symbols("T L N C I M")
    parameters = a, b, c1, KT, m, q, uc, r2, pI, gI, KL, al1, f, g, h, p, KN, al2, beta, KC, pt, gt, w, muI, gamma = _symbols(
        "a b c1 KT m q uc r2 pI gI KL al1 f g h p KN al2 beta KC pt gt w muI gamma"
    )
    rates = [
        a * T * (1 - b * T) - c1 * N * T - KT * M * T,
        -m * L - q * L * T - uc * L**2 + r2 * C * T + pI * L * In / (gI + In) - KL * M * L,
        al1 - f * N + g * T * N / (h + T) - p * N * T - KN * M * N,
        al2 - beta * C - KC * M * C,
        pt * T * L / (gt + T) + w * L * In - muI * In,
        -gamma * M,
    ]
    known = {"lymphocytes": [0, 1, 0, 0, 0, 0], "chemotherapy": [0, 0, 0, 0, 0, 1], "interleukin": [0, 0, 0, 0, 1, 0]}
    return _system(states, rates, parameters, [L, N, M], known=known)


def tumour_angiogenesis() -> od.ControlAffineSystem:
    """Gompertz growth towards a carrying capacity that a known dose of an inhibitor reduces; the volume measured."""
    states = V, K, g = _symbols("V K g")
    parameters = lam, b, d, e, clearance = _symbols("lambda b d e clearance")
    rates = [-lam * V * ca.log(V / K), b * V - d * K * V ** (2 / 3) - e * K * g, -clearance * g]
    return _system(states, rates, parameters, [V], known={"dose": [0, 0, 1]})


def chemotherapy_immunity() -> od.ControlAffineSystem:
    """Drug, tumour, immune cells, activating and suppressing signals; the tumour measured, the dose known."""
    states = C, T, In, X, Y = _symbols("C T I X Y")
    parameters = k1, k2, ka, kb, kc, kd, ke, kf, kg, kh, ki, kj, kk, kl, km = _symbols("k1 k2 ka kb kc kd ke kf kg kh ki kj kk kl km")
    rates = [
        -k1 * C / (k2 + C),
        ka * T - kb * C * T / (kc + T) - kd * T * In,
        X - ke * T * In - kf * C * In - kg * In * Y - kh * In,
        C / (1 + C * ki) - kj * X - kk * X * Y,
        In / (1 + C * kl) - km * Y * C,
    ]
    return _system(states, rates, parameters, [T], known={"u": [1, 0, 0, 0, 0]})


# ---------------------------------------------------------------- drugs and metabolism


def _two_compartments(fixed: str, input_kind: str) -> od.ControlAffineSystem:
    states = x1, x2 = _symbols("x1 x2")
    k1e, k12, k21, b = parameters = _symbols("k1e k12 k21 b")
    if "k1e" in fixed:
        k1e, parameters = 2, parameters[1:]
    if "b" in fixed:
        b, parameters = 1, parameters[:-1]
    rates = [-(k1e + k12) * x1 + k21 * x2, k12 * x1 - k21 * x2]
    return _system(states, rates, parameters, [x1], **{input_kind: {"u": [b, 0]}})


def two_compartments_known() -> od.ControlAffineSystem:
    """C2M: two compartments, the first measured, its input known."""
    return _two_compartments("", "known")


def two_compartments_unknown() -> od.ControlAffineSystem:
    """C2M with unknown input and known gain of the input."""
    return _two_compartments("b", "unknown")


def two_compartments_unknown_elimination_known() -> od.ControlAffineSystem:
    """C2M with unknown input, known gain of the input and known elimination."""
    return _two_compartments("b k1e", "unknown")


def _four_compartment_pk(input_kind: str) -> od.ControlAffineSystem:
    states = x1, x2, x3, x4 = _symbols("x1 x2 x3 x4")
    parameters = k1, k2, k3, k4, k5, k6, k7, s2, s3 = _symbols("k1 k2 k3 k4 k5 k6 k7 s2 s3")
    rates = [-(k1 + k2) * x1, k1 * x1 - (k3 + k6 + k7) * x2 + k5 * x4, k2 * x1 + k3 * x2 - k4 * x3, k6 * x2 - k5 * x4]
    return _system(states, rates, parameters, [s2 * x2, s3 * x3], **{input_kind: {"u": [1, 0, 0, 0]}})


def four_compartments_known() -> od.ControlAffineSystem:
    """Four pools of a drug, two scaled outputs, the input known."""
    return _four_compartment_pk("known")


def four_compartments_unknown() -> od.ControlAffineSystem:
    """Four pools of a drug, two scaled outputs, the input unknown."""
    return _four_compartment_pk("unknown")


def pharm() -> od.ControlAffineSystem:
    """Glucose oxidase: two substances taken up by the same receptor, one measured."""
    states = x0, x1, x2, x3 = _symbols("x0 x1 x2 x3")
    parameters = a1, a2, ka, kc, n, b1, b2 = _symbols("a1 a2 ka kc n b1 b2")
    bound = kc * ka + kc * x2 + ka * x0
    rates = [a1 * (x1 - x0) - ka * n * x0 / bound, a2 * (x0 - x1), b1 * (x3 - x2) - kc * n * x2 / bound, b2 * (x2 - x3)]
    return _system(states, rates, parameters, [x0])


def bilirubin() -> od.ControlAffineSystem:
    """Four mammillary compartments, known infusion into the measured one."""
    states = x1, x2, x3, x4 = _symbols("x1 x2 x3 x4")
    parameters = k01, k12, k13, k14, k21, k31, k41 = _symbols("k01 k12 k13 k14 k21 k31 k41")
    rates = [
        -(k21 + k31 + k41 + k01) * x1 + k12 * x2 + k13 * x3 + k14 * x4,
        k21 * x1 - k12 * x2,
        k31 * x1 - k13 * x3,
        k41 * x1 - k14 * x4,
    ]
    return _system(states, rates, parameters, [x1], known={"u": [1, 0, 0, 0]})


def pitavastatin() -> od.ControlAffineSystem:
    """Uptake of a drug into liver cells by a saturating transporter, a scaled sum measured."""
    states = x1, x2, x3 = _symbols("x1 x2 x3")
    parameters = k, k1, k2, k3, k4, r1, r3, T0 = _symbols("k k1 k2 k3 k4 r1 r3 T0")
    rates = [
        k3 * x3 - r3 * x1 - k1 * x1 * (T0 - x2) + r1 * x2,
        k1 * x1 * (T0 - x2) - (r1 + k2) * x2,
        r3 * x1 - (k3 + k4) * x3 + k2 * x2,
    ]
    return _system(states, rates, parameters, [k * (x2 + x3)])


def bound_drug() -> od.ControlAffineSystem:
    """A drug bound by two kinds of sites: five pools, the excreted one measured, the dose known."""
    states = q1, q3, q35, q36, q7 = _symbols("q1 q3 q35 q36 q7")
    parameters = k3, k4, k5, k6, k7, R, S, V3, V36 = _symbols("k3 k4 k5 k6 k7 R S V3 V36")
    first = k5 * q3 * (R * V3 - q35) - k6 * q35
    second = k5 * q3 * (5 * V36 / V3) * (S * V36 - q36) - k6 * q36
    rates = [k4 * q3 - (k3 + k7) * q1, k3 * q1 - k4 * q3 - first - second, first, second, k7 * q1]
    return _system(states, rates, parameters, [q7], known={"u": [1, 0, 0, 0, 0]})


def _bolie(outputs: int, input_kind: str) -> od.ControlAffineSystem:
    states = q1, q2 = _symbols("q1 q2")
    parameters = p1, p2, p3, p4, Vp = _symbols("p1 p2 p3 p4 Vp")
    measured = [q1 / Vp, q2 / Vp][:outputs]
    return _system(states, [p1 * q1 - p2 * q2, p3 * q2 + p4 * q1], parameters, measured, **{input_kind: {"delta": [1, 0]}})


def bolie_glucose() -> od.ControlAffineSystem:
    """Glucose and insulin, glucose measured, its appearance known."""
    return _bolie(1, "known")


def bolie_unknown_glucose() -> od.ControlAffineSystem:
    """Glucose and insulin both measured, the appearance of glucose unknown."""
    return _bolie(2, "unknown")


def minimal_model() -> od.ControlAffineSystem:
    """Glucose and insulin action; plasma insulin drives them and is known; glucose measured."""
    states = G, X = _symbols("G X")
    parameters = p1, p2, p3, Gb, Ib = _symbols("p1 p2 p3 Gb Ib")
    return _system(states, [-(p1 + X) * G + p1 * Gb, -p2 * X - p3 * Ib], parameters, [G], known={"insulin": [0, p3]})


def minimal_model_unknown_meal() -> od.ControlAffineSystem:
    """Minimal model with insulin known and measured glucose, its appearance unknown."""
    states = G, X = _symbols("G X")
    parameters = p1, p2, p3, Gb, Ib = _symbols("p1 p2 p3 Gb Ib")
    rates = [-(p1 + X) * G + p1 * Gb, -p2 * X - p3 * Ib]
    return _system(states, rates, parameters, [G], known={"insulin": [0, p3]}, unknown={"meal": [1, 0]})


def _hovorka(input_kind: str) -> od.ControlAffineSystem:
    states = Q1, Q2, S1, S2, In, x1, x2, x3 = _symbols("Q1 Q2 S1 S2 I x1 x2 x3")
    parameters = k12, F01, EGP0, VG, VI, ke, tmax, ka1, ka2, ka3, kb1, kb2, kb3 = _symbols(
        "k12 F01 EGP0 VG VI ke tmax ka1 ka2 ka3 kb1 kb2 kb3"
    )
    rates = [
        -F01 - x1 * Q1 + k12 * Q2 + EGP0 * (1 - x3),
        x1 * Q1 - (k12 + x2) * Q2,
        -S1 / tmax,
        (S1 - S2) / tmax,
        S2 / (tmax * VI) - ke * In,
        kb1 * In - ka1 * x1,
        kb2 * In - ka2 * x2,
        kb3 * In - ka3 * x3,
    ]
    insulin, meal = {"insulin": [0, 0, 1, 0, 0, 0, 0, 0]}, {"meal": [1, 0, 0, 0, 0, 0, 0, 0]}
    given = {"known": insulin | meal} if input_kind == "known" else {"known": insulin, "unknown": meal}
    return _system(states, rates, parameters, [Q1 / VG, In], **given)


def hovorka() -> od.ControlAffineSystem:
    """Eight states of glucose and insulin; both concentrations measured, insulin and meal known."""
    return _hovorka("known")


def hovorka_unknown_meal() -> od.ControlAffineSystem:
    """Eight states of glucose and insulin; both concentrations measured, insulin known, the meal unknown."""
    return _hovorka("unknown")


def _beta_cells(input_kind: str) -> od.ControlAffineSystem:
    states = G, beta, In = _symbols("G beta I")
    parameters = p, s, g, c, alpha = _symbols("p s g c alpha")
    grow = 0.021 / (24 * 60) / (1 + (8.4 / G) ** 1.7)
    shrink = 0.025 / (24 * 60) / (1 + (G / 4.8) ** 8.5)
    rates = [-(c + s * In) * G, beta * (grow - shrink), p * beta * G**2 / (alpha**2 + G**2) - g * In]
    return _system(states, rates, parameters, [G], **{input_kind: {"meal": [1, 0, 0]}})


def beta_insulin_glucose() -> od.ControlAffineSystem:
    """Glucose, beta cells and insulin with real exponents; glucose measured, the meal known."""
    return _beta_cells("known")


def beta_insulin_glucose_unknown_meal() -> od.ControlAffineSystem:
    """Glucose, beta cells and insulin with real exponents; glucose measured, the meal unknown."""
    return _beta_cells("unknown")


def biohydrogenation() -> od.ControlAffineSystem:
    """Fatty acids in the rumen, two of four measured."""
    states = x4, x5, x6, _ = _symbols("x4 x5 x6 x7")
    parameters = k5, k6, k7, k8, k9, k10 = _symbols("k5 k6 k7 k8 k9 k10")
    first, second, third = k5 * x4 / (k6 + x4), k7 * x5 / (k8 + x5 + x6), k9 * x6 * (k10 - x6) / k10
    return _system(states, [-first, first - second, second - third, third], parameters, [x4, x5])


# ---------------------------------------------------------------- compartments in general


def bilinear() -> od.ControlAffineSystem:
    """LLW1987: a bilinear system whose output is the product of two first-order responses, the input known."""
    states = x1, x2, x3 = _symbols("x1 x2 x3")
    parameters = p1, p2, p3, p4 = _symbols("p1 p2 p3 p4")
    field = [p2, p4, p4 * x1 + p2 * x2]
    return _system(states, [-p1 * x1, -p3 * x2, -(p1 + p3) * x3], parameters, [x3], known={"u": field})


def quadratic_pair() -> od.ControlAffineSystem:
    """Vajda: two quadratic rates, the first state measured, the input known."""
    states = x1, x2 = _symbols("x1 x2")
    parameters = t1, t2, t3, t4 = _symbols("t1 t2 t3 t4")
    return _system(states, [t1 * x1**2 + t2 * x1 * x2, t3 * x1**2 + t4 * x1 * x2], parameters, [x1], known={"u": [1, 0]})


def directed_cycle() -> od.ControlAffineSystem:
    """Five compartments in a directed cycle with leaks from the second and third, input to the first, the fifth measured."""
    states = x = _symbols("x1 x2 x3 x4 x5")
    k = _symbols("k21 k32 k43 k54 k15")
    leak2, leak3 = _symbols("k02 k03")
    rates = [k[i - 1] * x[i - 1] - k[i] * x[i] for i in range(5)]
    rates[1] -= leak2 * x[1]
    rates[2] -= leak3 * x[2]
    return _system(states, rates, [*k, leak2, leak3], [x[4]], known={"u": [1, 0, 0, 0, 0]})


def catenary_chain() -> od.ControlAffineSystem:
    """Twelve compartments in a chain, exchange both ways, a leak from the first, where the known input and the output are."""
    count = 12
    x = [ca.SX.sym(f"x{i}") for i in range(1, count + 1)]
    forth = [ca.SX.sym(f"k{i + 1}_{i}") for i in range(1, count)]
    back = [ca.SX.sym(f"k{i}_{i + 1}") for i in range(1, count)]
    leak = ca.SX.sym("k0_1")
    flow = [forth[i] * x[i] - back[i] * x[i + 1] for i in range(count - 1)]
    rates = [-leak * x[0] - flow[0], *(flow[i - 1] - flow[i] for i in range(1, count - 1)), flow[-1]]
    return _system(x, rates, [*forth, *back, leak], [x[0]], known={"u": [1] + [0] * (count - 1)})


def saturating_chain() -> od.ControlAffineSystem:
    """Sixteen compartments one after another behind a saturating first one; first and last measured, the input known."""
    count = 16
    x = [ca.SX.sym(f"x{i}") for i in range(1, count + 1)]
    p = [ca.SX.sym(f"p{i}") for i in range(1, count + 1)]
    vm, km = _symbols("vm km")
    rates = [-vm * x[0] / (km + x[0]) - p[0] * x[0], *(p[i - 1] * x[i - 1] - p[i] * x[i] for i in range(1, count))]
    return _system(x, rates, [vm, km, *p], [x[0], x[-1]], known={"u": [1] + [0] * (count - 1)})


def saturating_chain_unknown_input() -> od.ControlAffineSystem:
    """Sixteen compartments one after another behind a saturating first one; the fourth and the last measured, the input unknown."""
    count = 16
    x = [ca.SX.sym(f"x{i}") for i in range(1, count + 1)]
    p = [ca.SX.sym(f"p{i}") for i in range(1, count + 1)]
    vm, km = _symbols("vm km")
    rates = [-vm * x[0] / (km + x[0]) - p[0] * x[0], *(p[i - 1] * x[i - 1] - p[i] * x[i] for i in range(1, count))]
    return _system(x, rates, [vm, km, *p], [x[3], x[-1]], unknown={"w": [1] + [0] * (count - 1)})


# ---------------------------------------------------------------- chemical reactions and bioreactors


def reaction_network() -> od.ControlAffineSystem:
    """Six species, six mass-action rates, two species measured."""
    states = x1, x2, x3, x4, x5, x6 = _symbols("x1 x2 x3 x4 x5 x6")
    parameters = k1, k2, k3, k4, k5, k6 = _symbols("k1 k2 k3 k4 k5 k6")
    rates = [
        -k1 * x1 * x2 + k2 * x4 + k4 * x6,
        -k1 * x1 * x2 + (k2 + k3) * x4,
        k3 * x4 + k5 * x6 - k6 * x3 * x5,
        k1 * x1 * x2 - (k2 + k3) * x4,
        (k4 + k5) * x6 - k6 * x3 * x5,
        -(k4 + k5) * x6 + k6 * x3 * x5,
    ]
    return _system(states, rates, parameters, [x3, x2])


def hyperchaos() -> od.ControlAffineSystem:
    """Qi's hyperchaotic system, the first state measured."""
    states = x, y, z, w = _symbols("x y z w")
    parameters = a, b, c, d, e, f = _symbols("a b c d e f")
    return _system(states, [a * (y - x) + y * z, b * (x + y) - x * z, -c * z - d * w + x * y, e * z - f * w + x * y], parameters, [x])


def arrhenius_reactor() -> od.ControlAffineSystem:
    """Stirred tank with heating jacket and an Arrhenius rate; product and temperature measured, two known flows."""
    states = Ca, Cb, T, Tj = _symbols("Ca Cb T Tj")
    parameters = Ca0, V, k0, ER, Ta, DH, UA, Th, Vh, rocp, rocph = _symbols("Ca0 V k0 ER Ta DH UA Th Vh rocp rocph")
    rate = k0 * ca.exp(-ER / T) * Ca
    heat = UA * (Tj - T)
    rates = [-rate, rate, -(rate * DH) / rocp + heat / (V * rocp), -heat / (Vh * rocph)]
    known = {"feed": [(Ca0 - Ca) / V, -Cb / V, (Ta - T) / V, 0], "jacket": [0, 0, 0, (Th - Tj) / Vh]}
    return _system(states, rates, parameters, [Cb, T], known=known)


def cooled_reactor_unknown_feed() -> od.ControlAffineSystem:
    """Dimensionless jacketed tank with an exponential rate; both temperatures measured, coolant known, feed concentration unknown."""
    states = x1, x2, x3 = _symbols("x1 x2 x3")
    parameters = q, phi, beta, gamma, delta, delta1, delta2, x2f, x3f = _symbols("q phi beta gamma delta delta1 delta2 x2f x3f")
    rate = phi * x1 * ca.exp(x2 / (1 + x2 / gamma))
    rates = [-q * x1 - rate, q * (x2f - x2) - delta * (x2 - x3) + beta * rate, delta1 * delta * delta2 * (x2 - x3)]
    known, unknown = {"coolant": [0, 0, delta1 * (x3f - x3)]}, {"feed": [q, 0, 0]}
    return _system(states, rates, parameters, [x2, x3], known=known, unknown=unknown)


def monod_chemostat() -> od.ControlAffineSystem:
    """Biomass on one substrate, Monod growth; biomass measured, the dilution known."""
    states = X, S = _symbols("X S")
    parameters = mu, K, Y, feed = _symbols("mu K Y feed")
    growth = mu * S / (K + S) * X
    return _system(states, [growth, -growth / Y], parameters, [X], known={"dilution": [-X, feed - S]})


def haldane_chemostat_unknown_feed_two_outputs() -> od.ControlAffineSystem:
    """Biomass on an inhibiting substrate; both measured, the dilution constant, the feed unknown."""
    states = X, S = _symbols("X S")
    parameters = mu, K, Ki, Y, D = _symbols("mu K Ki Y D")
    growth = mu * S / (K + S + S**2 / Ki) * X
    return _system(states, [growth - D * X, -growth / Y - D * S], parameters, [X, S], unknown={"feed": [0, D]})


def chemostat_unknown_growth() -> od.ControlAffineSystem:
    """Biomass of unknown growth rate; the substrate measured, the dilution known."""
    states = X, S = _symbols("X S")
    parameters = Y, feed = _symbols("Y feed")
    return _system(states, [0, 0], parameters, [S], known={"dilution": [-X, feed - S]}, unknown={"growth": [X, -X / Y]})


def chemostat_unknown_growth_product() -> od.ControlAffineSystem:
    """Biomass of unknown growth rate with a product; substrate and product measured, dilution known."""
    states = X, S, Z = _symbols("X S Z")
    parameters = Y, feed, a, b = _symbols("Y feed a b")
    known = {"dilution": [-X, feed - S, -Z]}
    return _system(states, [0, 0, b * X], parameters, [S, Z], known=known, unknown={"growth": [X, -X / Y, a * X]})


def anaerobic_digestion() -> od.ControlAffineSystem:
    """AM2 with its kinetics; the two substrates measured, the dilution known."""
    states = X1, X2, S1, S2 = _symbols("X1 X2 S1 S2")
    parameters = m1, K1, m2, K2, Ki, k1, k2, k3, alpha, S1f, S2f = _symbols("m1 K1 m2 K2 Ki k1 k2 k3 alpha S1f S2f")
    first, second = m1 * S1 / (K1 + S1) * X1, m2 * S2 / (K2 + S2 + S2**2 / Ki) * X2
    rates = [first, second, -k1 * first, k2 * first - k3 * second]
    return _system(states, rates, parameters, [S1, S2], known={"dilution": [-alpha * X1, -alpha * X2, S1f - S1, S2f - S2]})


def anaerobic_digestion_unknown_growth() -> od.ControlAffineSystem:
    """AM2 whose two growth rates are unknown; substrates, alkalinity and carbon measured, the dilution constant."""
    states = X1, X2, S1, S2, Z, C = _symbols("X1 X2 S1 S2 Z C")
    parameters = k1, k2, k3, k4, k5, alpha, D, S1f, S2f, Zf, Cf = _symbols("k1 k2 k3 k4 k5 alpha D S1f S2f Zf Cf")
    rates = [-alpha * D * X1, -alpha * D * X2, D * (S1f - S1), D * (S2f - S2), D * (Zf - Z), D * (Cf - C)]
    unknown = {"growth1": [X1, 0, -k1 * X1, k2 * X1, 0, k4 * X1], "growth2": [0, X2, 0, -k3 * X2, 0, k5 * X2]}
    return _system(states, rates, parameters, [S1, S2, Z, C], unknown=unknown)


# ---------------------------------------------------------------- signalling


def _akt(is_constant: bool) -> od.ControlAffineSystem:
    states = R, pR, pRA, A, pA, S6, pAS6, pS6, ER = _symbols("EGFR pEGFR pEGFR_Akt Akt pAkt S6 pAkt_S6 pS6 EGF_EGFR")
    parameters = t, k1, l1, k2, l2, k3, k4, k5, l5, k6, k7, k8, k9, a1, a2, a3 = _symbols(
        "turnover r1_k1 r1_k2 r2_k1 r2_k2 r3_k1 r4_k1 r5_k1 r5_k2 r6_k1 r7_k1 r8_k1 r9_k1 a1 a2 a3"
    )
    rates = [
        68190 * t + ER * l1 - R * t,
        ER * k9 - pR * k4 + pRA * l2 + pRA * k3 - A * pR * k2,
        A * pR * k2 - pRA * k3 - pRA * l2,
        pA * k7 + pRA * l2 - A * pR * k2,
        pAS6 * l5 - pA * k7 + pAS6 * k6 + pRA * k3 - S6 * pA * k5,
        pAS6 * l5 + pS6 * k8 - S6 * pA * k5,
        S6 * pA * k5 - pAS6 * k6 - pAS6 * l5,
        pAS6 * k6 - pS6 * k8,
        -ER * l1 - ER * k9,
    ]
    if is_constant:
        rates[0], rates[8] = ER * (l1 - k1) - R * t, ER * (k1 - k9 - l1)
        known = {"production": [t, 0, 0, 0, 0, 0, 0, 0, 0]}
    else:
        known = {"EGF": [-R * k1, 0, 0, 0, 0, 0, 0, 0, R * k1]}
    return _system(states, rates, parameters, [a1 * (pR + pRA), a2 * (pA + pAS6), a3 * pS6], known=known)


def akt() -> od.ControlAffineSystem:
    """EGF to Akt to S6 with complexes; three scaled sums measured, EGF known."""
    return _akt(False)


def akt_known_production() -> od.ControlAffineSystem:
    """EGF to Akt to S6 with complexes; three scaled sums measured, the production of the receptor known."""
    return _akt(True)


def double_phosphorylation() -> od.ControlAffineSystem:
    """Two sites, one kinase, one phosphatase, all complexes; phosphatase and the four phosphoforms measured."""
    states = S00, S01, S10, S11, K, F, KS00, KS01, KS10, FS01, FS10, FS11 = _symbols("S00 S01 S10 S11 K F KS00 KS01 KS10 FS01 FS10 FS11")
    kinase = a00, a01, a10, b00, b01, b10, c0001, c0010, c0011, c0111, c1011 = _symbols(
        "a00 a01 a10 b00 b01 b10 c0001 c0010 c0011 c0111 c1011"
    )
    phosphatase = d01, d10, d11, e01, e10, e11, g0100, g1000, g1100, g1101, g1110 = _symbols(
        "alpha01 alpha10 alpha11 beta01 beta10 beta11 gamma0100 gamma1000 gamma1100 gamma1101 gamma1110"
    )
    k00, k01, k10 = a00 * K * S00 - b00 * KS00, a01 * K * S01 - b01 * KS01, a10 * K * S10 - b10 * KS10
    f01, f10, f11 = d01 * F * S01 - e01 * FS01, d10 * F * S10 - e10 * FS10, d11 * F * S11 - e11 * FS11
    c00, g11 = (c0001 + c0010 + c0011) * KS00, (g1100 + g1101 + g1110) * FS11
    rates = [
        -k00 + g0100 * FS01 + g1000 * FS10 + g1100 * FS11,
        -k01 + c0001 * KS00 - f01 + g1101 * FS11,
        -k10 + c0010 * KS00 - f10 + g1110 * FS11,
        -f11 + c0111 * KS01 + c1011 * KS10 + c0011 * KS00,
        -k00 + c00 - k01 + c0111 * KS01 - k10 + c1011 * KS10,
        -f01 + g0100 * FS01 - f10 + g1000 * FS10 - f11 + g11,
        k00 - c00,
        k01 - c0111 * KS01,
        k10 - c1011 * KS10,
        f01 - g0100 * FS01,
        f10 - g1000 * FS10,
        f11 - g11,
    ]
    return _system(states, rates, [*kinase, *phosphatase], [F, S00, S01, S10, S11])


def mapk_feedback() -> od.ControlAffineSystem:
    """Three tiers with negative and positive feedback, both Hill exponents unknown; all tiers measured."""
    states = x1, x2, x3 = _symbols("x1 x2 x3")
    parameters = k1, k2, k3, k4, k5, k6, s1t, s2t, s3t, KK1, KK2, n1, n2, alpha = _symbols(
        "k1 k2 k3 k4 k5 k6 s1t s2t s3t KK1 KK2 n1 n2 alpha"
    )
    rates = [
        k1 * (s1t - x1) * KK1**n1 / (KK1**n1 + x3**n1) - k2 * x1,
        k3 * (s2t - x2) * x1 * (1 + alpha * x3**n2 / (KK2**n2 + x3**n2)) - k4 * x2,
        k5 * (s3t - x3) * x2 - k6 * x3,
    ]
    return _system(states, rates, parameters, states)


def kholodenko_cascade() -> od.ControlAffineSystem:
    """Eight phosphoforms, ten Michaelis-Menten rates, ultrasensitive feedback; the active forms of three tiers measured."""
    states = a0, a1, b0, b1, b2, c0, c1, c2 = _symbols("MKKK MKKKP MKK MKKP MKKPP MAPK MAPKP MAPKPP")
    V = _symbols("V1 V2 k3 k4 V5 V6 k7 k8 V9 V10")
    K = [ca.SX.sym(f"K{i}") for i in range(1, 11)]
    Ki, n = _symbols("KI n")
    enzyme = [1 / (1 + (c2 / Ki) ** n), 1, a1, a1, 1, 1, b2, b2, 1, 1]
    substrate = [a0, a1, b0, b1, b2, b1, c0, c1, c2, c1]
    v = [V[i] * enzyme[i] * substrate[i] / (K[i] + substrate[i]) for i in range(10)]
    rates = [
        v[1] - v[0],
        v[0] - v[1],
        v[5] - v[2],
        v[2] + v[4] - v[3] - v[5],
        v[3] - v[4],
        v[9] - v[6],
        v[6] + v[8] - v[7] - v[9],
        v[7] - v[8],
    ]
    return _system(states, rates, [*V, *K, Ki, n], [a1, b2, c2])


def _stat5(input_kind: str) -> od.ControlAffineSystem:
    states = x1, x2, x3, x4 = _symbols("x1 x2 x3 x4")
    parameters = p1, p2, p3, p4, s1, s2 = _symbols("p1 p2 p3 p4 s1 s2")
    rates = [2 * p4 * x4, -p2 * x2**2, p2 * x2**2 / 2 - p3 * x3, p3 * x3 - p4 * x4]
    outputs = [s1 * (x2 + 2 * x3), s2 * (x1 + x2 + 2 * x3)]
    return _system(states, rates, parameters, outputs, **{input_kind: {"EpoR": [-p1 * x1, p1 * x1, 0, 0]}})


def stat5_known() -> od.ControlAffineSystem:
    """STAT5 through the nucleus and back; two scaled sums measured, the active receptor known."""
    return _stat5("known")


def stat5_unknown() -> od.ControlAffineSystem:
    """STAT5 through the nucleus and back; two scaled sums measured, the active receptor unknown."""
    return _stat5("unknown")


def _il13(input_kind: str) -> od.ControlAffineSystem:
    states = x1, x2, x3, x4, x5, x6, x8, x10, x11, x13 = _symbols("x1 x2 x3 x4 x5 x6 x8 x10 x11 x13")
    parameters = [ca.SX.sym(f"t{i}") for i in range(1, 23)]
    t = dict(enumerate(parameters, 1))
    free = 2.8 - x6
    rates = [
        -t[5] * x1 + t[6] * x2,
        t[5] * x1 - t[6] * x2,
        -t[2] * x3 * free,
        t[2] * x3 * free - t[3] * x4,
        t[3] * x4 - t[4] * x5,
        -t[7] * x3 * x6 / (1 + t[13] * x1) - t[7] * x4 * x6 / (1 + t[13] * x13) + t[8] * free * 91,
        -t[9] * x8 * free + t[10] * (165 - x8) * 91,
        t[11] * (165 - x8),
        0,
        x10 * t[14] / (t[15] + x10) - t[16] * x13,
    ]
    outputs = [
        x1 + x3 + x4,
        t[18] * (x3 + x4 + x5 + 0.34 - x11),
        t[19] * (x4 + x5),
        t[20] * free,
        t[21] * x10,
        t[22] * x10 * t[17] / t[11],
        x13,
        165 - x8,
    ]
    binding = [-2.265 * t[1] * x1, 0, 2.265 * t[1] * x1, 0, 0, 0, 0, 0, -2.265 * t[12] * x11, 0]
    return _system(states, rates, parameters, outputs, **{input_kind: {"IL13": binding}})


def il13_known() -> od.ControlAffineSystem:
    """IL13 to JAK2 and STAT5 in lymphoma: ten states, 22 parameters, eight outputs, IL13 known."""
    return _il13("known")


def il13_unknown() -> od.ControlAffineSystem:
    """IL13 to JAK2 and STAT5 in lymphoma: ten states, 22 parameters, eight outputs, IL13 unknown."""
    return _il13("unknown")


def _nf_kb(input_kind: str) -> od.ControlAffineSystem:
    states = _symbols("x1 x2 x3 x4 x5 x6 x7 x8 x9 x10 x11 x12 x13 x14 x15")
    x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11, x12, x13, x14, x15 = states
    parameters = t1, t2, c3a, c4a, c5, k1, k2, k3, kprod, kdeg, i1, e2a, i1a = _symbols("t1 t2 c3a c4a c5 k1 k2 k3 kprod kdeg i1 e2a i1a")
    a1, a2, a3, c1, c3, c4, c5a, c6a, kv, e1a = 0.5, 0.2, 1, 5e-7, 4e-4, 0.5, 1e-4, 2e-5, 5, 5e-4
    rates = [
        kprod - kdeg * x1,
        -(k3 + kdeg) * x2 - a2 * x2 * x10 + t1 * x4 - a3 * x2 * x13 + t2 * x5,
        k3 * x2 - kdeg * x3,
        a2 * x2 * x10 - t1 * x4,
        a3 * x2 * x13 - t2 * x5,
        c6a * x13 - a1 * x6 * x10 + t2 * x5 - i1 * x6,
        i1 * kv * x6 - a1 * x11 * x7,
        c4 * x9 - c5 * x8,
        c1 * x7 - c3 * x9,
        -a2 * x2 * x10 - a1 * x10 * x6 + c4a * x12 - c5a * x10 - i1a * x10 + e1a * x11,
        -a1 * x11 * x7 + i1a * kv * x10 - e1a * kv * x11,
        c1 * x7 - c3a * x12,
        a1 * x10 * x6 - c6a * x13 - a3 * x2 * x13 + e2a * x14,
        a1 * x11 * x7 - e2a * kv * x14,
        c1 * x7 - c3 * x15,
    ]
    signal = [-k1 * x1, k1 * x1 - k2 * x2 * x8, k2 * x2 * x8] + [0] * 12
    return _system(states, rates, parameters, [x7, x10 + x13, x9, x1 + x2 + x3, x2, x12], **{input_kind: {"TNF": signal}})


def nf_kb_known() -> od.ControlAffineSystem:
    """NF-kB with IkBa and A20: fifteen states, thirteen unknown parameters, six outputs, TNF known."""
    return _nf_kb("known")


def nf_kb_unknown() -> od.ControlAffineSystem:
    """NF-kB with IkBa and A20: fifteen states, thirteen unknown parameters, six outputs, TNF unknown."""
    return _nf_kb("unknown")


# ---------------------------------------------------------------- genes and clocks


def goodwin() -> od.ControlAffineSystem:
    """Goodwin's oscillator made rational: the Hill term is a state of its own; the messenger measured."""
    states = x1, x2, x3, x4 = _symbols("x1 x2 x3 x4")
    parameters = b, c, alpha, beta, gamma, delta, sigma = _symbols("b c alpha beta gamma delta sigma")
    change = gamma * x2 - delta * x3
    return _system(states, [-b * x1 + 1 / (c + x4), alpha * x1 - beta * x2, change, sigma * x4 * change / x3], parameters, [x1])


def goodwin_exponent() -> od.ControlAffineSystem:
    """Goodwin's oscillator with its Hill exponent unknown; the messenger measured."""
    states = x1, x2, x3 = _symbols("x1 x2 x3")
    parameters = a, b, A, sigma, alpha, beta, gamma, delta = _symbols("a b A sigma alpha beta gamma delta")
    return _system(states, [-b * x1 + a / (A + x3**sigma), alpha * x1 - beta * x2, gamma * x2 - delta * x3], parameters, [x1])


def _toggle_switch(is_known: bool) -> od.ControlAffineSystem:
    x1, x2 = _symbols("x1 x2")
    k01, k1, n1, k02, k2, n2 = _symbols("k01 k1 ntetr k02 k2 nlaci")
    if is_known:
        u1, u2, atc, natc, iptg, niptg = _symbols("aTc IPTG tatc natc tiptg niptg")
        block1, block2, extra = (u1 / atc) ** natc, (u2 / iptg) ** niptg, [atc, natc, iptg, niptg]
        inputs = {"known": {"aTc_rate": [0, 0, 1, 0], "IPTG_rate": [0, 0, 0, 1]}}
        outputs = [x1, x2, u1, u2]
    else:
        u1, u2 = _symbols("w1 w2")
        block1, block2, extra = u1, u2, []
        inputs = {"unknown": {"w1_rate": [0, 0, 1, 0], "w2_rate": [0, 0, 0, 1]}}
        outputs = [x1, x2]
    rates = [k01 + k1 / (1 + (x2 / (1 + block1)) ** n1) - x1, k02 + k2 / (1 + (x1 / (1 + block2)) ** n2) - x2, 0, 0]
    return _system([x1, x2, u1, u2], rates, [k01, k1, n1, k02, k2, n2, *extra], outputs, **inputs)


def toggle_switch_known() -> od.ControlAffineSystem:
    """Two repressors with four unknown Hill exponents; the inducers are measured states driven by known rates."""
    return _toggle_switch(True)


def toggle_switch_unknown() -> od.ControlAffineSystem:
    """Two repressors with two unknown Hill exponents; the effects of the inducers are states driven by unknown rates."""
    return _toggle_switch(False)


def repressilator() -> od.ControlAffineSystem:
    """Three genes in a ring, each with its own strength and Hill exponent; the first two proteins measured."""
    states = _symbols("m1 m2 m3 p1 p2 p3")
    m, p = states[:3], states[3:]
    alpha, n = _symbols("alpha1 alpha2 alpha3"), _symbols("n1 n2 n3")
    leak, beta = _symbols("alpha0 beta")
    rates = [-m[i] + alpha[i] / (1 + p[i - 1] ** n[i]) + leak for i in range(3)] + [-beta * (p[i] - m[i]) for i in range(3)]
    return _system(states, rates, [*alpha, *n, leak, beta], p[:2])


def genetic_oscillator() -> od.ControlAffineSystem:
    """Activator and repressor with their genes and messengers; free activator and repressor measured."""
    states = DA, DAp, DR, DRp, MA, MR, A, R, C = _symbols("DA DAp DR DRp MA MR A R C")
    parameters = aA, aAp, aR, aRp, bA, bR, dMA, dMR, dA, dR, gA, gR, gC, tA, tR = _symbols(
        "aA aAp aR aRp bA bR dMA dMR dA dR gA gR gC tA tR"
    )
    bindA, bindR = gA * DA * A - tA * DAp, gR * DR * A - tR * DRp
    rates = [
        -bindA,
        bindA,
        -bindR,
        bindR,
        aAp * DAp + aA * DA - dMA * MA,
        aRp * DRp + aR * DR - dMR * MR,
        bA * MA - bindA - bindR - gC * A * R - dA * A,
        bR * MR - gC * A * R + dA * C - dR * R,
        gC * A * R - dA * C,
    ]
    return _system(states, rates, parameters, [A, R])


def circadian_clock() -> od.ControlAffineSystem:
    """Locke's clock of Arabidopsis: seven states, 28 parameters, one of them an exponent; both messengers measured, light known."""
    states = x1, x2, x3, x4, x5, x6, x7 = _symbols("x1 x2 x3 x4 x5 x6 x7")
    parameters = _symbols("a n1 n2 g1 g2 k1 k2 k3 k4 k5 k6 k7 m1 m2 m3 m4 m5 m6 m7 p1 p2 p3 q1 q2 r1 r2 r3 r4")
    a, n1, n2, g1, g2, k1, k2, k3, k4, k5, k6, k7, m1, m2, m3, m4, m5, m6, m7, p1, p2, p3, q1, q2, r1, r2, r3, r4 = parameters
    rates = [
        n1 * x6**a / (g1**a + x6**a) - m1 * x1 / (k1 + x1),
        p1 * x1 - r1 * x2 + r2 * x3 - m2 * x2 / (k2 + x2),
        r1 * x2 - r2 * x3 - m3 * x3 / (k3 + x3),
        n2 * g2**2 / (g2**2 + x3**2) - m4 * x4 / (k4 + x4),
        p2 * x4 - r3 * x5 + r4 * x6 - m5 * x5 / (k5 + x5),
        r3 * x5 - r4 * x6 - m6 * x6 / (k6 + x6),
        p3 - m7 * x7 / (k7 + x7),
    ]
    return _system(states, rates, parameters, [x1, x4], known={"light": [q1 * x7, 0, 0, 0, 0, 0, -(p3 + q2 * x7)]})


# ---------------------------------------------------------------- the cases

CASES = (
    Case(
        "lotka volterra",
        "modified Lotka-Volterra, test model of Hong, Ovchinnikov, Pogudin, Yap 2019, Bioinformatics 35 (SIAN); agrees with the"
        " identifiable functions published with StructuralIdentifiability.jl",
        lotka_volterra,
        5,
        _words("x1 a b d"),
    ),
    Case(
        "three species lotka volterra",
        "Remien, Eckwright, Ridenhour 2021, R. Soc. Open Sci. 8, with three species of which two are counted",
        three_species_lotka_volterra,
        14,
        _words("x1 x2 r1 r2 r3 b11 b12 b21 b22 b31 b32"),
    ),
    Case(
        "compositional lotka volterra",
        "Joseph, Shenhav, Xavier, Halperin, Pe'er 2020, PLOS Comput. Biol. 16, three species on the simplex; seven symmetries: "
        "one constant added to all b, one to each column of a, one moved from each g into its row of a",
        compositional_lotka_volterra,
        10,
        _words("x1 x2"),
    ),
    Case(
        "cholera",
        "SIWR: Lee, Kelly, Ochocki et al. 2017, J. Theor. Biol. 420, eq. 3; agrees with the identifiable functions published "
        "with StructuralIdentifiability.jl",
        cholera,
        11,
        _words("S I W R mu bi bw a gamma xi k"),
    ),
    Case(
        "seaijrc",
        "Roosa, Chowell 2019, Theor. Biol. Med. Model. 16, model 2; agrees with the identifiable functions published with "
        "StructuralIdentifiability.jl",
        seaijrc,
        13,
        _words("I J C Ninv b k g1 alpha g2"),
    ),
    Case(
        "forced sirs",
        "Capistran, Moreles, Lara 2009, Bull. Math. Biol. 71, eqs. 7-11; agrees with the identifiable functions published with "
        "StructuralIdentifiability.jl",
        forced_sirs,
        10,
        _words("s i r mu b0 g nu M"),
    ),
    Case(
        "sliqr",
        "Dankwa, Brouwer, Donnelly 2022, Epidemics 41, eq. 4; agrees with the identifiable functions published with "
        "StructuralIdentifiability.jl",
        sliqr,
        10,
        _words("S L I Q b a g s e Ninv"),
    ),
    Case(
        "treatment",
        "Tuncer, Le 2018, Math. Biosci. 299, eq. 2.4; agrees with the identifiable functions published with StructuralIdentifiability.jl",
        treatment,
        8,
        _words("T N nu"),
    ),
    Case(
        "seir births",
        "Massonis, Banga, Villaverde 2021, Annu. Rev. Control 51, table 2, model 34; agrees with the identifiable functions "
        "published with StructuralIdentifiability.jl",
        seir_births,
        10,
        _words("A S E I mu epsilon gamma K N"),
    ),
    Case(
        "seir detected",
        "Massonis, Banga, Villaverde 2021, Annu. Rev. Control 51, table 2, model 51; agrees with the identifiable functions "
        "published with StructuralIdentifiability.jl",
        seir_detected,
        20,
        _words("S E I De Di F beta beta_d q nu mu_0 s phi_e gamma mu_i phi s_d gamma_d mu_d N"),
    ),
    Case(
        "quarantine isolation",
        "Gallina 2012, dynamic models for the analysis of epidemic spreads, eqs. 2.17-2.22",
        quarantine_isolation,
        23,
        _words("S I A Q J R b l ea eq ej d1 k1 g1 m2 d2 m1 d4 k2 d5 g2 d6 d3"),
    ),
    Case(
        "hospital deaths",
        "Fokas, Cuevas-Maraver, Kevrekidis 2020, Chaos Solitons Fractals 140, eqs. 1-6",
        hospital_deaths,
        12,
        _words("D r1"),
    ),
    Case(
        "sidarthe",
        "Giordano, Blanchini, Bruno et al. 2020, Nat. Med. 26; outputs chosen here",
        sidarthe,
        21,
        _words("D R T E beta delta eta nu tau rho xi sigma"),
    ),
    Case(
        "hiv immune control",
        "Wodarz, Nowak 1999, PNAS 96; agrees with the identifiable functions published with StructuralIdentifiability.jl",
        hiv_immune_control,
        13,
        _words("w z d a u b h"),
    ),
    Case(
        "hiv latent",
        "Saccomani, Bellu 2008, DAISY case studies, eq. 9; agrees with the identifiable functions published with "
        "StructuralIdentifiability.jl",
        hiv_latent,
        12,
        _words("x1 x4 b d s w2 c"),
    ),
    Case(
        "hiv known infection rate",
        "Miao, Xia, Perelson, Wu 2011, SIAM Rev. 53, model with a time-varying infection rate, the rate known",
        hiv_known_infection_rate,
        8,
        _words("Tu Ti V lambda rho N delta c"),
    ),
    Case(
        "hiv unknown infection rate",
        "Miao, Xia, Perelson, Wu 2011, SIAM Rev. 53, model with a time-varying infection rate; the symmetry that keeps V, Tu + "
        "Ti, (rho - delta) Ti and N delta / (rho - delta) leaves delta free; Martinelli 2023, arXiv 2211.13507, likewise contradicts "
        "earlier results on this model with time-varying rates",
        hiv_unknown_infection_rate,
        7,
        _words("V lambda rho c"),
    ),
    Case(
        "hiv unknown infection rate, degree 1",
        "Miao, Xia, Perelson, Wu 2011, SIAM Rev. 53, model with a time-varying infection rate, the rate linear in time: all is "
        "observable, as analyses that bound the number of derivatives of the rate find",
        hiv_unknown_infection_rate,
        10,
        _words("Tu Ti V lambda rho N delta c"),
        disturbance=1,
    ),
    Case(
        "cd8 t cells",
        "Crauste, Mafille, Boucinha et al. 2017, Cell Systems 4, figure 3C; agrees with the identifiable functions published "
        "with StructuralIdentifiability.jl",
        cd8_t_cells,
        17,
        _words("N E S M mu_N mu_EE delta_EL delta_LM mu_LL mu_LE mu_M mu_P mu_PE mu_PL"),
    ),
    Case(
        "car t leukaemia",
        "Leon-Triana, Sabir, Calvo et al. 2021, Commun. Nonlinear Sci. Numer. Simul. 94, eq. 1",
        car_t_leukaemia,
        19,
        _words("C L B P I rhoc rhob tauc rhol alpha taui taub rhop ap ks taup rhoi ai beta"),
    ),
    Case(
        "pancreatic tumour",
        "Hu, Ke, Jang 2019, Bull. Math. Biol. 81, eq. 6, b1 and b2 used twice as in the benchmark of Rey Barreiro, Villaverde "
        "2023, Bioinformatics 39",
        pancreatic_tumour,
        24,
        _words("x y z r1 b1 r2 b2 mu2 mu3 r3 k4 mu4 k5 mu5"),
    ),
    Case(
        "chemo immunotherapy",
        "de Pillis, Fister, Gu et al. 2008, J. Biol. Syst. 16, eqs. 1-6, without the fractional kill by effector cells",
        chemo_immunotherapy,
        29,
        _words("L N I M a c1 KT m uc pI gI KL al1 f g KN beta KC pt w muI gamma"),
    ),
    Case(
        "tumour angiogenesis",
        "Hahnfeldt, Panigrahy, Folkman, Hlatky 1999, Cancer Res. 59, one inhibitor with first-order clearance",
        tumour_angiogenesis,
        8,
        _words("V K g lambda b d e clearance"),
    ),
    Case(
        "chemotherapy immunity",
        "Tran, Al-Radhawi, Kareva et al. 2020, Front. Immunol. 11, 1376, eqs. 1-5",
        chemotherapy_immunity,
        20,
        _words("C T I X Y k1 k2 ka kb kc kd ke kf kg kh ki kj kk kl km"),
    ),
    Case(
        "two compartments known",
        "C2M: Villaverde, Evans, Chappell, Banga 2019, IEEE Control Syst. Lett. 3",
        two_compartments_known,
        6,
        _words("x1 x2 k1e k12 k21 b"),
    ),
    Case(
        "two compartments unknown",
        "C2M: Villaverde, Evans, Chappell, Banga 2019, IEEE Control Syst. Lett. 3, input unknown, b known; an arbitrary input "
        "explains any output",
        two_compartments_unknown,
        1,
        _words("x1"),
    ),
    Case(
        "two compartments unknown, degree 2",
        "C2M: Villaverde, Evans, Chappell, Banga 2019, IEEE Control Syst. Lett. 3, input quadratic in time, b known; b known "
        "does not suffice, k1e keeps one freedom",
        two_compartments_unknown,
        7,
        _words("x1"),
        disturbance=2,
    ),
    Case(
        "two compartments unknown elimination known",
        "C2M: Villaverde, Evans, Chappell, Banga 2019, IEEE Control Syst. Lett. 3, input unknown, b and k1e known; an arbitrary"
        " input explains any output",
        two_compartments_unknown_elimination_known,
        1,
        _words("x1"),
    ),
    Case(
        "two compartments unknown elimination known, degree 4",
        "C2M: Villaverde, Evans, Chappell, Banga 2019, IEEE Control Syst. Lett. 3, input of degree four in time, b and k1e "
        "known: all is observable",
        two_compartments_unknown_elimination_known,
        9,
        _words("x1 x2 k12 k21"),
        disturbance=4,
    ),
    Case(
        "four compartments known",
        "Merkt, Timmer, Kaschek 2015, Phys. Rev. E 92, pharmacokinetic model; agrees with the identifiable functions published "
        "with StructuralIdentifiability.jl",
        four_compartments_known,
        12,
        _words("x1 k4 k5 k6"),
    ),
    Case(
        "four compartments unknown",
        "Merkt, Timmer, Kaschek 2015, Phys. Rev. E 92, pharmacokinetic model; input unknown as in the STRIKE-GOLDD collection, "
        "but arbitrary",
        four_compartments_unknown,
        9,
        _words("k4 k5 k6"),
    ),
    Case(
        "pharm",
        "Demignot, Domurado 1987, Drug Des. Deliv. 1; Hong, Ovchinnikov, Pogudin, Yap 2020, Commun. Pure Appl. Math. 73, "
        "example 6.4; agrees with the identifiable functions published with StructuralIdentifiability.jl",
        pharm,
        11,
        _words("x0 x1 x2 x3 a1 a2 ka kc n b1 b2"),
    ),
    Case(
        "bilirubin",
        "Meshkat, Kuo, DiStefano 2014, PLOS ONE 9, eq. 14 (COMBOS); agrees with the identifiable functions published with "
        "StructuralIdentifiability.jl",
        bilirubin,
        11,
        _words("x1 x2 x3 x4 k01 k12 k13 k14 k21 k31 k41"),
    ),
    Case(
        "pitavastatin",
        "Grandjean, Chappell, Yates, Evans 2014, Comput. Methods Programs Biomed. 114, eqs. 22-24; agrees with the identifiable"
        " functions published with StructuralIdentifiability.jl",
        pitavastatin,
        10,
        _words("k2 k3 k4 r1 r3"),
    ),
    Case(
        "bound drug",
        "Chappell, Godfrey, Vajda 1990, Math. Biosci. 102; Sedoglavic 2002, J. Symb. Comput. 33; agrees with the identifiable "
        "functions published with StructuralIdentifiability.jl",
        bound_drug,
        13,
        _words("q1 q3 q35 q36 q7 k3 k4 k5 k6 k7"),
    ),
    Case("bolie glucose", "Bolie 1961, J. Appl. Physiol. 16", bolie_glucose, 6, _words("q1 p1 p3 Vp")),
    Case(
        "bolie unknown glucose",
        "Bolie 1961, J. Appl. Physiol. 16, both concentrations measured; the unknown input is posed here",
        bolie_unknown_glucose,
        4,
        _words("p3 p4"),
    ),
    Case(
        "minimal model",
        "Bergman, Ider, Bowden, Cobelli 1979, Am. J. Physiol. 236, basal insulin unknown",
        minimal_model,
        6,
        _words("G p2 p3"),
    ),
    Case(
        "minimal model unknown meal",
        "Bergman, Ider, Bowden, Cobelli 1979, Am. J. Physiol. 236, basal insulin unknown; the unknown meal is posed here; two "
        "symmetries: Gb against the meal, p1 against X, Ib and the meal",
        minimal_model_unknown_meal,
        5,
        _words("G p2 p3"),
    ),
    Case(
        "hovorka",
        "Hovorka, Canonico, Chassin et al. 2004, Physiol. Meas. 25, constant fluxes, gut left out; one symmetry: EGP0, F01, x3 and kb3",
        hovorka,
        20,
        _words("Q1 Q2 S1 S2 I x1 x2 k12 VG VI ke tmax ka1 ka2 ka3 kb1 kb2"),
    ),
    Case(
        "hovorka unknown meal",
        "Hovorka, Canonico, Chassin et al. 2004, Physiol. Meas. 25, constant fluxes, gut left out; the unknown meal is posed "
        "here; four symmetries: EGP0 against x3 and kb3, F01 against the meal, the initial x3 against the meal, all glucose "
        "against VG",
        hovorka_unknown_meal,
        17,
        _words("S1 S2 I x1 x2 k12 VI ke tmax ka1 ka2 ka3 kb1 kb2"),
    ),
    Case(
        "beta insulin glucose",
        "Topp, Promislow, de Vries et al. 2000, J. Theor. Biol. 206; Karin, Swisa, Glaser et al. 2016, Mol. Syst. Biol. 12, "
        "figure 1D; scaling I, beta, s and p as in Villaverde, Banga 2017, PLOS Comput. Biol. 13",
        beta_insulin_glucose,
        6,
        _words("G g c alpha"),
    ),
    Case(
        "beta insulin glucose unknown meal",
        "Topp, Promislow, de Vries et al. 2000, J. Theor. Biol. 206; Karin, Swisa, Glaser et al. 2016, Mol. Syst. Biol. 12, "
        "figure 1D; an arbitrary meal explains any output",
        beta_insulin_glucose_unknown_meal,
        1,
        _words("G"),
    ),
    Case(
        "beta insulin glucose unknown meal, degree 0",
        "Topp, Promislow, de Vries et al. 2000, J. Theor. Biol. 206; Karin, Swisa, Glaser et al. 2016, Mol. Syst. Biol. 12, "
        "figure 1D, the meal constant and unknown",
        beta_insulin_glucose_unknown_meal,
        7,
        _words("G g c alpha"),
        disturbance=0,
    ),
    Case(
        "biohydrogenation",
        "Moate, Boston, Jenkins, Lean 2008, J. Dairy Sci. 91, eqs. 6-9; agrees with the identifiable functions published with "
        "StructuralIdentifiability.jl",
        biohydrogenation,
        9,
        _words("x4 x5 x6 k5 k6 k7 k8 k9 k10"),
    ),
    Case(
        "bilinear",
        "Lecourtier, Lamnabhi-Lagarrigue, Walter 1987, 26th CDC, example 1; agrees with the identifiable functions published "
        "with StructuralIdentifiability.jl",
        bilinear,
        6,
        _words("x3 p1 p3"),
    ),
    Case(
        "quadratic pair",
        "Vajda, Godfrey, Rabitz 1989, Math. Biosci. 93; one symmetry: the scale of x2",
        quadratic_pair,
        5,
        _words("x1 t1 t4"),
    ),
    Case(
        "directed cycle",
        "Ahmed, Crepeau, Dessauer et al. 2026, SIAM J. Appl. Dyn. Syst. 25, appendix A",
        directed_cycle,
        11,
        _words("x1 x2 x4 x5 k21 k54 k15"),
    ),
    Case(
        "catenary chain",
        "Meshkat, Sullivant, Eisenberg 2015, Bull. Math. Biol. 77: a catenary model with input, output and the only leak in its"
        " first compartment is identifiable; twelve compartments",
        catenary_chain,
        35,
        _words(
            "x1 x2 x3 x4 x5 x6 x7 x8 x9 x10 x11 x12 k2_1 k3_2 k4_3 k5_4 k6_5 k7_6 k8_7 k9_8 k10_9 k11_10 k12_11 "
            "k1_2 k2_3 k3_4 k4_5 k5_6 k6_7 k7_8 k8_9 k9_10 k10_11 k11_12 k0_1"
        ),
    ),
    Case(
        "saturating chain",
        "Saccomani, Audoly, Bellu, D'Angio 2010, Comput. Biol. Med. 40, section 6, cut to sixteen compartments and two outputs",
        saturating_chain,
        34,
        _words("x1 x2 x3 x4 x5 x6 x7 x8 x9 x10 x11 x12 x13 x14 x15 x16 vm km p1 p2 p3 p4 p5 p6 p7 p8 p9 p10 p11 p12 p13 p14 p15 p16"),
    ),
    Case(
        "saturating chain unknown input",
        "Saccomani, Audoly, Bellu, D'Angio 2010, Comput. Biol. Med. 40, section 6, cut to sixteen compartments; the unknown "
        "input is posed here: of the eight quantities before the fourth compartment three combinations are seen",
        saturating_chain_unknown_input,
        29,
        _words("x4 x5 x6 x7 x8 x9 x10 x11 x12 x13 x14 x15 x16 p4 p5 p6 p7 p8 p9 p10 p11 p12 p13 p14 p15 p16"),
    ),
    Case(
        "reaction network",
        "Conradi, Shiu 2018, Biophys. J. 114, eq. 2; agrees with the identifiable functions published with StructuralIdentifiability.jl",
        reaction_network,
        12,
        _words("x1 x2 x3 x4 x5 x6 k1 k2 k3 k4 k5 k6"),
    ),
    Case(
        "hyperchaos",
        "Qi, van Wyk, van Wyk, Chen 2008, Phys. Lett. A 372, eq. 1 in the form of the benchmark of Dong et al. 2023; one "
        "symmetry: w replaced by a w + (1 - a) z",
        hyperchaos,
        9,
        _words("x y z a b"),
    ),
    Case(
        "arrhenius reactor",
        "Kumar, Daoutidis 1999, stirred tank of Sedoglavic 2002, J. Symb. Comput. 33, eq. 7.1, with the exponential written "
        "out; agrees with the identifiable functions published with StructuralIdentifiability.jl",
        arrhenius_reactor,
        14,
        _words("Ca Cb T Tj Ca0 V k0 ER Ta Th Vh"),
    ),
    Case(
        "cooled reactor unknown feed",
        "Russo, Bequette 1995, AIChE J. 41, three-state jacketed reactor; the unknown feed is posed here; one symmetry: x1 and "
        "the feed against beta",
        cooled_reactor_unknown_feed,
        11,
        _words("x2 x3 q phi gamma delta delta1 delta2 x2f x3f"),
    ),
    Case(
        "monod chemostat",
        "Monod growth in a chemostat, Bastin, Dochain 1990, On-line Estimation and Adaptive Control of Bioreactors, ch. 1",
        monod_chemostat,
        5,
        _words("X mu"),
    ),
    Case(
        "haldane chemostat unknown feed two outputs",
        "Haldane growth in a chemostat, Bastin, Dochain 1990, On-line Estimation and Adaptive Control of Bioreactors; the "
        "unknown feed is posed here; only the yield goes with it",
        haldane_chemostat_unknown_feed_two_outputs,
        6,
        _words("X S mu K Ki D"),
    ),
    Case(
        "chemostat unknown growth",
        "Bastin, Dochain 1990, On-line Estimation and Adaptive Control of Bioreactors, unknown specific growth rate; two "
        "symmetries: X against Y, X / Y against the growth rate",
        chemostat_unknown_growth,
        2,
        _words("S feed"),
    ),
    Case(
        "chemostat unknown growth product",
        "Bastin, Dochain 1990, On-line Estimation and Adaptive Control of Bioreactors, unknown specific growth rate and a "
        "product; one symmetry: the scale of X",
        chemostat_unknown_growth_product,
        6,
        _words("S Z feed"),
    ),
    Case(
        "anaerobic digestion",
        "AM2: Bernard, Hadj-Sadok, Dochain, Genovesi, Steyer 2001, Biotechnol. Bioeng. 75; two symmetries: the scales of X1 and X2",
        anaerobic_digestion,
        13,
        _words("S1 S2 m1 K1 m2 K2 Ki alpha S1f S2f"),
    ),
    Case(
        "anaerobic digestion unknown growth",
        "AM2: Bernard, Hadj-Sadok, Dochain, Genovesi, Steyer 2001, Biotechnol. Bioeng. 75, growth rates unknown, gas outflow left out",
        anaerobic_digestion_unknown_growth,
        9,
        _words("S1 S2 Z C D Zf"),
    ),
    Case(
        "akt",
        "Fujita, Toyoshima, Uda et al. 2010, Sci. Signal. 3, EGF varies in a known way, production of the receptor known up to "
        "its turnover",
        akt,
        25,
        _words(
            "EGFR pEGFR pEGFR_Akt Akt pAkt S6 pAkt_S6 pS6 EGF_EGFR turnover r1_k1 r1_k2 r2_k1 r2_k2 r3_k1 r4_k1 "
            "r5_k1 r5_k2 r6_k1 r7_k1 r8_k1 r9_k1 a1 a2 a3"
        ),
    ),
    Case(
        "akt known production",
        "Fujita, Toyoshima, Uda et al. 2010, Sci. Signal. 3, EGF constant; agrees with the identifiable functions published "
        "with StructuralIdentifiability.jl",
        akt_known_production,
        20,
        _words("r2_k2 r3_k1 r4_k1 r5_k2 r6_k1 r7_k1 r8_k1"),
    ),
    Case(
        "double phosphorylation",
        "Manrai, Gunawardena 2008, Biophys. J. 95, figure 1; full as published with StructuralIdentifiability.jl, which orders "
        "the rates otherwise",
        double_phosphorylation,
        34,
        _words(
            "S00 S01 S10 S11 K F KS00 KS01 KS10 FS01 FS10 FS11 a00 a01 a10 b00 b01 b10 c0001 c0010 c0011 c0111 "
            "c1011 alpha01 alpha10 alpha11 beta01 beta10 beta11 gamma0100 gamma1000 gamma1100 gamma1101 gamma1110"
        ),
    ),
    Case(
        "mapk feedback",
        "Nguyen, Degasperi, Cotter, Kholodenko 2015, Sci. Rep. 5",
        mapk_feedback,
        17,
        _words("x1 x2 x3 k1 k2 k3 k4 k5 k6 s1t s2t s3t KK1 KK2 n1 n2 alpha"),
    ),
    Case(
        "kholodenko cascade",
        "Kholodenko 2000, Eur. J. Biochem. 267; outputs chosen here",
        kholodenko_cascade,
        30,
        _words("MKKK MKKKP MKK MKKP MKKPP MAPK MAPKP MAPKPP V1 V2 k3 k4 V5 V6 k7 k8 V9 V10 K1 K2 K3 K4 K5 K6 K7 K8 K9 K10 KI n"),
    ),
    Case(
        "stat5 known",
        "Swameye, Mueller, Timmer et al. 2003, PNAS 100; Raue, Kreutz, Maiwald et al. 2009, Bioinformatics 25; the delay in the"
        " nucleus replaced by a rate; one symmetry: the scale of STAT5",
        stat5_known,
        9,
        _words("p1 p3 p4"),
    ),
    Case(
        "stat5 unknown",
        "Swameye, Mueller, Timmer et al. 2003, PNAS 100; Raue, Kreutz, Maiwald et al. 2009, Bioinformatics 25; the delay in the"
        " nucleus replaced by a rate; two symmetries: the scale of STAT5, p1 against the receptor",
        stat5_unknown,
        8,
        _words("p3 p4"),
    ),
    Case(
        "il13 known",
        "Raia, Schilling, Boehm et al. 2011, Cancer Res. 71",
        il13_known,
        30,
        _words("x1 x2 x3 x4 x5 x6 x8 x11 x13 t1 t2 t3 t4 t5 t6 t7 t8 t9 t10 t12 t13 t14 t16 t18 t19 t20"),
    ),
    Case(
        "il13 unknown",
        "Raia, Schilling, Boehm et al. 2011, Cancer Res. 71; the unknown IL13 is posed here; one symmetry more, t1 and t12 against IL13",
        il13_unknown,
        29,
        _words("x1 x2 x3 x4 x5 x6 x8 x11 x13 t2 t3 t4 t5 t6 t7 t8 t9 t10 t13 t14 t16 t18 t19 t20"),
    ),
    Case(
        "nf kb known",
        "Lipniacki, Paszek, Brasier, Luxon, Kimmel 2004, J. Theor. Biol. 228, eqs. 9-23; the thirteen parameters of "
        "Balsa-Canto, Alonso, Banga 2010, BMC Syst. Biol. 4, the others known; x15 reaches no output",
        nf_kb_known,
        27,
        _words("x1 x2 x3 x4 x5 x6 x7 x8 x9 x10 x11 x12 x13 x14 t1 t2 c3a c4a c5 k1 k2 k3 kprod kdeg i1 e2a i1a"),
    ),
    Case(
        "nf kb unknown",
        "Lipniacki, Paszek, Brasier, Luxon, Kimmel 2004, J. Theor. Biol. 228, eqs. 9-23; the thirteen parameters of "
        "Balsa-Canto, Alonso, Banga 2010, BMC Syst. Biol. 4, the others known; the unknown TNF is posed here",
        nf_kb_unknown,
        21,
        _words("x2 x4 x5 x6 x7 x9 x10 x11 x12 x13 x14 t1 t2 c3a c4a kprod kdeg i1 e2a i1a"),
    ),
    Case(
        "nf kb unknown, degree 0",
        "Lipniacki, Paszek, Brasier, Luxon, Kimmel 2004, J. Theor. Biol. 228, eqs. 9-23; the thirteen parameters of "
        "Balsa-Canto, Alonso, Banga 2010, BMC Syst. Biol. 4, the others known; the unknown TNF, constant, is posed here",
        nf_kb_unknown,
        27,
        _words("x1 x2 x3 x4 x5 x6 x7 x8 x9 x10 x11 x12 x13 x14 t1 t2 c3a c4a c5 k3 kprod kdeg i1 e2a i1a"),
        disturbance=0,
    ),
    Case(
        "goodwin",
        "Goodwin 1965, Adv. Enzyme Regul. 3, in the rational form of Hong et al. 2019, Bioinformatics 35; agrees with the "
        "identifiable functions published with StructuralIdentifiability.jl",
        goodwin,
        9,
        _words("x1 x4 b c beta delta sigma"),
    ),
    Case(
        "goodwin exponent",
        "Goodwin 1965, Adv. Enzyme Regul. 3; two symmetries: the scales of x2 and x3",
        goodwin_exponent,
        9,
        _words("x1 b sigma beta delta"),
    ),
    Case(
        "toggle switch known",
        "Lugagne, Carrillo, Kirch et al. 2017, Nat. Commun. 8; the inducers, nonlinear in the paper, are states with known rates",
        toggle_switch_known,
        14,
        _words("x1 x2 aTc IPTG k01 k1 ntetr k02 k2 nlaci tatc natc tiptg niptg"),
    ),
    Case(
        "toggle switch unknown",
        "Lugagne, Carrillo, Kirch et al. 2017, Nat. Commun. 8, unknown inputs as in Villaverde, Tsiantis, Banga 2019, J. R. "
        "Soc. Interface 16, but with arbitrary rates: only both outputs and their rates are seen",
        toggle_switch_unknown,
        4,
        _words("x1 x2"),
    ),
    Case(
        "repressilator",
        "Elowitz, Leibler 2000, Nature 403, with strengths and exponents of their own",
        repressilator,
        14,
        _words("m1 m2 m3 p1 p2 p3 alpha1 alpha2 alpha3 n1 n2 n3 alpha0 beta"),
    ),
    Case(
        "genetic oscillator",
        "Vilar, Kueh, Barkai, Leibler 2002, PNAS 99; two symmetries: the scales of the messengers",
        genetic_oscillator,
        22,
        _words("DA DAp DR DRp A R C dMA dMR dA dR gA gR gC tA tR"),
    ),
    Case(
        "circadian clock",
        "Locke, Millar, Turner 2005, J. Theor. Biol. 234; initial values unknown",
        circadian_clock,
        32,
        _words("x1 x4 a n1 n2 k1 k4 m1 m4 q2 r1 r2 r3 r4"),
    ),
)
