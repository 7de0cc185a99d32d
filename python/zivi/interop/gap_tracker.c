/* One tracker a gap, the rest at right angles to impacts:
 *
 *     M q'' = F + B u + N^T lambda      W = N M^-1 N^T
 *     g_i'' = a_i                       the control of a zivi_tracker on gap i
 *     Z q'' = Z (qddot_r - kp (q - q_r) - kd (qdot - qdot_r))
 *     a_A   = -W_AA force_A             of contacts A that are held
 *
 * No call allocates, every loop has a constant bound. */

static real dot(const real *a, const real *b, int count)
{
    real sum = 0;
    int i;
    for (i = 0; i < count; i++)
        sum += a[i] * b[i];
    return sum;
}

/* L L^T = a, in its place; the least squared pivot as a part of its diagonal, <= 0 where there is none. */
static real factor(real *a, int size)
{
    real least = 1;
    int i, j;
    for (i = 0; i < size; i++) {
        const real diagonal = a[i * size + i];
        real left;
        for (j = 0; j < i; j++)
            a[i * size + j] =
                (a[i * size + j] - dot(&a[i * size], &a[j * size], j))
                / a[j * size + j];
        left = diagonal - dot(&a[i * size], &a[i * size], i);
        if (!(left > 0) || !isfinite(left))
            return -1;
        if (left / diagonal < least)
            least = left / diagonal;
        a[i * size + i] = sqrt(left);
    }
    return least;
}

/* b <- a^-1 b for a factor. */
static void solve(const real *a, int size, real *b)
{
    int i, j;
    for (i = 0; i < size; i++)
        b[i] = (b[i] - dot(&a[i * size], b, i)) / a[i * size + i];
    for (i = size - 1; i >= 0; i--) {
        for (j = i + 1; j < size; j++)
            b[i] -= a[j * size + i] * b[j];
        b[i] /= a[i * size + i];
    }
}

/* b <- a^-1 b by elimination; 0 where a is singular. */
static int eliminate(real *a, int size, real *b)
{
    int i, j, k;
    for (k = 0; k < size; k++) {
        int best = k;
        for (i = k + 1; i < size; i++)
            if (fabs(a[i * size + k]) > fabs(a[best * size + k]))
                best = i;
        if (!(fabs(a[best * size + k]) > 0))
            return 0;
        for (j = 0; j < size; j++) {
            const real kept = a[k * size + j];
            a[k * size + j] = a[best * size + j];
            a[best * size + j] = kept;
        }
        {
            const real kept = b[k];
            b[k] = b[best];
            b[best] = kept;
        }
        for (i = k + 1; i < size; i++) {
            const real part = a[i * size + k] / a[k * size + k];
            for (j = k; j < size; j++)
                a[i * size + j] -= part * a[k * size + j];
            b[i] -= part * b[k];
        }
    }
    for (k = size - 1; k >= 0; k--) {
        for (j = k + 1; j < size; j++)
            b[k] -= a[k * size + j] * b[j];
        b[k] /= a[k * size + k];
    }
    return 1;
}

/* b_A <- W_AA^-1 b_A. */
static void solve_among(const real *w, const uint8_t *set, real *b)
{
    real small[GAPS * GAPS], right[GAPS];
    int places[GAPS], count = 0, i, j;
    for (i = 0; i < GAPS; i++)
        if (set[i])
            places[count++] = i;
    for (i = 0; i < count; i++) {
        for (j = 0; j < count; j++)
            small[i * count + j] = w[places[i] * GAPS + places[j]];
        right[i] = b[places[i]];
    }
    factor(small, count);
    solve(small, count, right);
    for (i = 0; i < count; i++)
        b[places[i]] = right[i];
}

/* The forces with which landings press the contacts that are held, 0 elsewhere. */
static void usual_forces(const real *w, const uint8_t *held, real *forces)
{
    int i, pushes = 1;
    for (i = 0; i < GAPS; i++)
        forces[i] = held[i] ? PRESS[i] : 0;
    solve_among(w, held, forces);
    for (i = 0; i < GAPS; i++)
        pushes = pushes && (!held[i] || forces[i] > 0);
    for (i = 0; i < GAPS; i++)
        if (!pushes && held[i])
            forces[i] = PRESS[i] / w[i * GAPS + i];
}

/* Which contacts are held; whether one was lost. */
static int look(controller *it, const real *gaps, const real *rates, const real *normals,
                const uint8_t *resting)
{
    int i, any = 0;
    for (i = 0; i < GAPS; i++) {
        const real size = sqrt(dot(&normals[i * COORDINATES], &normals[i * COORDINATES], COORDINATES));
        const real near = LATCH[0] > size * NOISE[0] ? LATCH[0] : size * NOISE[0];
        const real slow = LATCH[1] > size * NOISE[1] ? LATCH[1] : size * NOISE[1];
        const int stays = fabs(gaps[i]) <= near, settles = stays && fabs(rates[i]) <= slow;
        const int closes = resting[i] && !it->held[i] && settles;
        int lost;
        it->beyond[i] = it->held[i] && !stays ? it->beyond[i] + 1 : 0;
        lost = it->held[i] && resting[i] && it->beyond[i] >= 5;
        any = any || lost;
        it->held[i] = (uint8_t)((it->held[i] && resting[i] && !lost) || closes);
    }
    return any;
}

/* The accelerations that are asked of the gaps; a code < 0 of a tracker that refuses. */
static int wanted(controller *it, const real *gaps, const real *rates, const real *w,
                  const sample *now, const sample *next, const uint8_t *resting, real *a)
{
    real usual[GAPS], forces[GAPS];
    int i, any = 0, landing = 0;
    for (i = 0; i < GAPS; i++) {
        const reference from = {now->gaps[i], now->gap_rates[i], now->sides[i]};
        const reference to = {next->gaps[i], next->gap_rates[i], next->sides[i]};
        const real x = it->held[i] || gaps[i] < 0 ? 0 : gaps[i];
        const real xdot = it->held[i] ? 0 : rates[i];
        const int32_t code = tracker_step_to(&it->trackers[i], x, xdot, 0, &from, &to,
                                             now->accelerations[i], &a[i]);
        if (code < 0)
            return code;
        any = any || it->held[i];
        landing = landing || (resting[i] && !it->held[i]);
    }
    if (!any)
        return 0;
    usual_forces(w, it->held, usual);
    for (i = 0; i < GAPS; i++)
        forces[i] = !landing && it->held[i] && it->force[i] > 0 ? it->force[i] : usual[i];
    for (i = 0; i < GAPS; i++) {
        const real by = dot(&w[i * GAPS], forces, GAPS), by_usual = dot(&w[i * GAPS], usual, GAPS);
        const real excess = by_usual - (real)0.8 * WEAKEST[i];
        if (it->held[i])
            a[i] = -by;
        else
            a[i] -= resting[i] ? by - by_usual + (excess > 0 ? excess : 0) : by;
    }
    return 0;
}

/* The controls; a code < 0 where there are none. */
static int follow(controller *it, real t, const real *q, const real *qdot, const sample *now,
                  const sample *next, real *u)
{
    real row[ROW], mass[COORDINATES * COORDINATES], mobility[GAPS * COORDINATES];
    real w[GAPS * GAPS], factored[GAPS * GAPS], rates[GAPS], a[GAPS], left[GAPS];
    real rest[COORDINATES], matrix[COORDINATES * COORDINATES], sent[COORDINATES];
    const real *force = row + COORDINATES * COORDINATES, *gaps = force + COORDINATES;
    const real *normals = gaps + GAPS, *curvatures = normals + GAPS * COORDINATES;
    const real *moved = curvatures + GAPS;
    uint8_t resting[GAPS];
    int i, j, code, limited = 0;
    if (system_at(t, q, qdot, row, it->parameters) != 0)
        return controller_E_MODEL;
    inputs_at(t, q, matrix, it->parameters);
    for (i = 0; i < COORDINATES * COORDINATES; i++)
        mass[i] = row[i];
    if (!(factor(mass, COORDINATES) > 0))
        return controller_E_MODEL;
    for (i = 0; i < GAPS; i++) {
        for (j = 0; j < COORDINATES; j++)
            mobility[i * COORDINATES + j] = normals[i * COORDINATES + j];
        solve(mass, COORDINATES, &mobility[i * COORDINATES]);
        rates[i] = dot(&normals[i * COORDINATES], qdot, COORDINATES) + moved[i];
        resting[i] = (uint8_t)(now->contacts[i] != 0 && next->contacts[i] != 0);
    }
    for (i = 0; i < GAPS; i++)
        for (j = 0; j <= i; j++) {
            const real one = dot(&normals[i * COORDINATES], &mobility[j * COORDINATES], COORDINATES);
            const real other = dot(&normals[j * COORDINATES], &mobility[i * COORDINATES], COORDINATES);
            w[i * GAPS + j] = (one + other) / 2;
            w[j * GAPS + i] = (one + other) / 2;
        }
    for (i = 0; i < GAPS * GAPS; i++)
        factored[i] = w[i];
    if (!(factor(factored, GAPS) > REDUNDANT))
        return controller_E_DEPENDENT;
    if (look(it, gaps, rates, normals, resting))
        it->status |= LATCH_LOST;
    code = wanted(it, gaps, rates, w, now, next, resting, a);
    if (code < 0)
        return code;
    for (j = 0; j < COORDINATES; j++)
        rest[j] = now->qddot[j] - POSTURE[0] * (q[j] - now->q[j]) - POSTURE[1] * (qdot[j] - now->qdot[j]);
    for (i = 0; i < GAPS; i++) {
        const real beside = GAPS == COORDINATES ? 0 : dot(&normals[i * COORDINATES], rest, COORDINATES);
        left[i] = a[i] - curvatures[i] - beside;
    }
    solve(factored, GAPS, left);
    for (j = 0; j < COORDINATES; j++) {
        real sum = GAPS == COORDINATES ? 0 : dot(&row[j * COORDINATES], rest, COORDINATES);
        for (i = 0; i < GAPS; i++)
            sum += left[i] * normals[i * COORDINATES + j];
        sent[j] = sum - force[j];
    }
    if (!eliminate(matrix, COORDINATES, sent))
        return controller_E_UNREACHED;
    for (j = 0; j < COORDINATES; j++) {
        if (!isfinite(sent[j]))
            return controller_E_MODEL;
        if (sent[j] < LIMITS[j][0] || sent[j] > LIMITS[j][1]) {
            sent[j] = sent[j] < LIMITS[j][0] ? LIMITS[j][0] : LIMITS[j][1];
            limited = 1;
        }
    }
    for (j = 0; j < COORDINATES; j++)
        u[j] = sent[j];
    if (limited)
        it->status |= SATURATED;
    return 0;
}

int32_t controller_init(controller *it)
{
    int i;
    controller blank = {0};
    *it = blank;
    for (i = 0; i < PARAMETERS; i++)
        it->parameters[i] = PARAMETER[i];
    for (i = 0; i < GAPS; i++) {
        tracker_config config;
        int32_t code;
        tracker_defaults(&config);
        config.mu1 = GAINS[i][0];
        config.mu2 = GAINS[i][1];
        config.e = RESTITUTION[i];
        config.h = PERIOD;
        config.horizon = HORIZON;
        config.shift = SHIFT;
        code = tracker_init(&it->trackers[i], &config);
        if (code < 0)
            return code;
        it->force[i] = FORCE[i];
    }
    return 0;
}

int32_t controller_step(controller *it, real t, const real *q, const real *qdot, const sample *now,
                        const sample *next, real *u)
{
    sample landing = {0};
    int j, code = 0, good = 1;
    for (j = 0; j < COORDINATES; j++)
        good = good && isfinite(q[j]) && isfinite(qdot[j]);
    it->status = 0;
    if (good && (now == NULL || next == NULL)) {
        for (j = 0; j < COORDINATES; j++) {
            if (!it->placed)
                it->place[j] = q[j];
            landing.q[j] = it->place[j];
        }
        for (j = 0; j < GAPS; j++)
            landing.sides[j] = landing.contacts[j] = 1;
        it->placed = 1;
        now = next = &landing;
    }
    if (good)
        code = follow(it, t, q, qdot, now, next, it->u);
    if (!good || code < 0)
        it->status |= REFUSED;
    for (j = 0; j < COORDINATES; j++)
        u[j] = it->u[j];
    return code < 0 ? code : (int32_t)it->status;
}

uint32_t controller_size(void)
{
    return sizeof(controller);
}
