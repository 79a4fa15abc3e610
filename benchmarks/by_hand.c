/* PID and Fuzzy-PID as one writes them by hand, with all that they do here: derivative modes and filter, limits of the
 * command and of the integral, three kinds of anti-windup, the same terms. To compare the exported ones with. */

typedef struct {
    double integral, error, measurement, derivative, effort;
    int started;
} Hand;

typedef struct {
    double error, error_rate, p_term, i_term, d_term, kp, ki, kd, alpha, unsaturated, effort;
    int held;
} HandTerms;

typedef struct {
    int derivative, antiwindup;
    double filter_time, u_min, u_max, i_min, i_max, tracking_time;
} HandLimits;

static double hand_limited(double u, const HandLimits *l) {
    return u > l->u_max ? l->u_max : u < l->u_min ? l->u_min : u;
}

static double hand_rate(const Hand *m, double e, double y, double rate, double dt, const HandLimits *l) {
    double d = -rate;
    if (l->derivative != 2) {
        d = !m->started ? 0.0 : l->derivative == 1 ? (m->measurement - y) / dt : (e - m->error) / dt;
    }
    if (l->filter_time > 0.0) {
        d = m->derivative + dt / (l->filter_time + dt) * (d - m->derivative);
    }
    return d;
}

static void hand_hold(const Hand *m, HandTerms *t, double kp, double ki, double kd, double alpha,
                      const HandLimits *l) {
    const HandTerms held = {m->error, m->derivative, 0.0, 0.0, 0.0, kp, ki, kd, alpha, m->effort,
                            hand_limited(m->effort, l), 1};
    *t = held;
}

static void hand_combine(Hand *m, HandTerms *t, double e, double y, double d, double dt, double kp, double ki,
                         double kd, double alpha, const HandLimits *l) {
    double integral = m->integral + dt * e;
    double i = ki * integral;
    if (i > l->i_max || i < l->i_min) {
        i = i > l->i_max ? l->i_max : l->i_min;
        integral = ki != 0.0 ? i / ki : integral;
    }
    const double p = kp * e, dd = kd * d, u = p + i + dd, effort = hand_limited(u, l);
    if (effort != u) {
        if (l->antiwindup == 1 && u * e > 0.0) {
            integral = m->integral;
        } else if (l->antiwindup == 2 && ki > 0.0) {
            double tracking = l->tracking_time > 0.0 ? l->tracking_time : kp / ki;
            tracking = tracking < dt ? dt : tracking;
            integral += dt * (effort - u) / (tracking * ki);
        }
    }
    const double total = effort + integral + d;
    if (total - total != 0.0) {
        hand_hold(m, t, kp, ki, kd, alpha, l);
        return;
    }
    const Hand next = {integral, e, y, d, effort, 1};
    const HandTerms terms = {e, d, p, i, dd, kp, ki, kd, alpha, u, effort, 0};
    *m = next;
    *t = terms;
}

static int hand_usable(double e, double rate, double dt) {
    const double sum = e + rate;
    return dt > 0.0 && sum - sum == 0.0;
}

#ifdef FUZZY
/* Peaks, tables and gains are those of the exported law: ERROR_PEAKS and the like name them. */
static int hand_locate(double x, const double *peaks, double *w) {
    int i = 0;
    if (!(x > peaks[0])) {
        *w = 0.0;
        return 0;
    }
    if (x >= peaks[6]) {
        *w = 1.0;
        return 5;
    }
    while (x >= peaks[i + 1]) {
        i++;
    }
    *w = (x - peaks[i]) / (peaks[i + 1] - peaks[i]);
    return i;
}

static double hand_bilinear(const double *table, double a, double b) {
    const double first = table[0] + b * (table[1] - table[0]), second = table[7] + b * (table[8] - table[7]);
    return first + a * (second - first);
}

static void hand_gains(double e, double d, double *kp, double *ki, double *kd, double *alpha, const double *box) {
    double a, b;
    const int corner = 7 * hand_locate(e, ERROR_PEAKS, &a) + hand_locate(d, RATE_PEAKS, &b);
    *kp = box[0] + (box[1] - box[0]) * hand_bilinear(KP + corner, a, b);
    *kd = box[2] + (box[3] - box[2]) * hand_bilinear(KD + corner, a, b);
    *alpha = hand_bilinear(ALPHA + corner, a, b);
    *kp = *kp > box[1] ? box[1] : *kp < box[0] ? box[0] : *kp;
    *kd = *kd > box[3] ? box[3] : *kd < box[2] ? box[2] : *kd;
    const double scale = *alpha * *kd;
    *ki = scale != 0.0 ? *kp * *kp / scale : INFINITE;
}

static void hand_update(Hand *m, HandTerms *t, double reference, double y, double rate, double dt,
                        const double *box, const HandLimits *l) {
    const double e = reference - y;
    double kp, ki, kd, alpha;
    if (!hand_usable(e, rate, dt)) {
        hand_gains(m->error, m->derivative, &kp, &ki, &kd, &alpha, box);
        hand_hold(m, t, kp, ki, kd, alpha, l);
        return;
    }
    const double d = hand_rate(m, e, y, rate, dt, l);
    hand_gains(e, d, &kp, &ki, &kd, &alpha, box);
    hand_combine(m, t, e, y, d, dt, kp, ki, kd, alpha, l);
}
#else
static void hand_update(Hand *m, HandTerms *t, double reference, double y, double rate, double dt,
                        const double *gains, const HandLimits *l) {
    const double e = reference - y, kp = gains[0], ki = gains[1], kd = gains[2];
    const double alpha = ki * kd > 0.0 ? kp * kp / (ki * kd) : 0.0;
    if (!hand_usable(e, rate, dt)) {
        hand_hold(m, t, kp, ki, kd, alpha, l);
        return;
    }
    const double d = hand_rate(m, e, y, rate, dt, l);
    hand_combine(m, t, e, y, d, dt, kp, ki, kd, alpha, l);
}
#endif
