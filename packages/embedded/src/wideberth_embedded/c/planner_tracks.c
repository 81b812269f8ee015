/* Memory of obstacles by identity: each measurement is filtered when it comes, and not kept. What
 * wideberth.framework.tracking does in Python: history, names, stand_ins. */
#include "planner_parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define FORGIVEN 1e-9    /* share of the largest entry that is rounding in a covariance */

void wb_axes(const double *matrix, double *values, double *vectors)
{
    const double a = matrix[0], b = 0.5 * (matrix[1] + matrix[2]), c = matrix[3];
    const double apart = hypot(a - c, 2.0 * b), angle = 0.5 * atan2(2.0 * b, a - c);
    double cosine = cos(angle), sine = sin(angle);
    if (b == 0.0) cosine = a >= c ? 1.0 : 0.0, sine = a >= c ? 0.0 : 1.0;
    values[0] = b == 0.0 ? fmax(a, c) : 0.5 * (a + c + apart);
    values[1] = b == 0.0 ? fmin(a, c) : 0.5 * (a + c - apart);
    vectors[0] = cosine, vectors[1] = -sine, vectors[2] = sine, vectors[3] = cosine;
}

/* Whether four numbers are a covariance, which is then `found`; its asymmetry is averaged out. */
static int covariance_of(const double *given, double *found)
{
    double symmetric[4], largest = 0.0, values[2], vectors[4];
    int k;
    for (k = 0; k < 4; k++) {
        if (!(fabs(given[k]) <= PLAN_VAGUEST * PLAN_VAGUEST)) return 0;
        largest = fmax(largest, fabs(given[k]));
    }
    if (fabs(0.5 * given[1] - 0.5 * given[2]) > 0.5 * FORGIVEN * largest) return 0;
    memcpy(symmetric, given, sizeof(symmetric));
    if (given[1] != given[2]) symmetric[1] = symmetric[2] = 0.5 * given[1] + 0.5 * given[2];
    wb_axes(symmetric, values, vectors);
    if (!(values[1] >= -FORGIVEN * largest)) return 0;
    memcpy(found, symmetric, sizeof(symmetric));
    return 1;
}

static struct log *known(struct history *history, const char *name)
{
    int k;
    for (k = 0; k < history->count; k++)
        if (strcmp(history->logs[k].name, name) == 0) return &history->logs[k];
    return NULL;
}

static int remembered(struct history *history, const char *name, double stamp)
{
    const struct log *log = known(history, name);
    return log && stamp - log->reported <= PLAN_FORGET;
}

static int named(const wideberth_detection *seen, int count, const char *name)
{
    int k;
    for (k = 0; k < count; k++)
        if (strcmp(seen[k].name, name) == 0) return 1;
    return 0;
}

/* Put stand-ins in the place of numbers that are of no use. */
static void completed(struct history *history, double stamp, wideberth_detection *one)
{
    const struct log *last
        = remembered(history, one->name, stamp) ? known(history, one->name) : NULL;
    const double usual = PLAN_USUAL_NOISE * PLAN_USUAL_NOISE;
    double found[4] = {usual, 0.0, 0.0, usual};
    if (!(one->radius >= 0.0 && one->radius <= PLAN_FARTHEST))
        one->radius = last ? last->radius : PLAN_UNKNOWN_RADIUS;
    if (one->age < 0.0) one->age = 0.0;
    if (!covariance_of(one->covariance, found) && last)
        memcpy(found, last->covariance, sizeof(found));
    memcpy(one->covariance, found, sizeof(found));
}

/* Whether it is known where an obstacle is, and when it was there. */
static int placed(const wideberth_detection *one)
{
    return fabs(one->position[0]) <= PLAN_FARTHEST && fabs(one->position[1]) <= PLAN_FARTHEST
        && fabs(one->age) <= PLAN_OLDEST;
}

/* All that have a place and are new enough, with stand-ins; returns how many. */
static int admitted(struct history *history, const wideberth_observation *seen,
    struct scratch *scratch)
{
    wideberth_detection *kept = scratch->seen;
    int count = 0, all, lost = 0, k;
    for (k = 0; k < seen->obstacles; k++) {
        const wideberth_detection *one = &seen->detections[k];
        if (!placed(one)) continue;
        kept[count] = *one;
        kept[count].name[WIDEBERTH_NAME - 1] = '\0';
        completed(history, seen->stamp, &kept[count++]);
    }
    all = count;
    history->placeless = 0;
    for (k = 0; k < seen->obstacles; k++) {
        const wideberth_detection *one = &seen->detections[k];
        wideberth_detection *room = &kept[all + lost];
        if (placed(one)) continue;
        *room = *one; /* behind the others, so that a second one of this name is noticed */
        room->name[WIDEBERTH_NAME - 1] = '\0';
        if (!remembered(history, room->name, seen->stamp) || named(kept, all + lost, room->name))
            history->placeless++;
        else
            lost++;
    }
    for (k = count = 0; k < all; k++)
        if (kept[k].age <= PLAN_FORGET) kept[count++] = kept[k];
    return count;
}

/* Of too many keep those that are nearest, in the order in which they came. */
static int nearest(wideberth_detection *seen, int count, const double *here,
    struct scratch *scratch)
{
    int k, rank, kept = 0;
    if (count <= PLAN_MOST || !here) return count < PLAN_MOST ? count : PLAN_MOST;
    for (k = 0; k < count; k++) {
        const double x = seen[k].position[0] - fmin(fmax(here[0], -PLAN_FARTHEST), PLAN_FARTHEST);
        const double y = seen[k].position[1] - fmin(fmax(here[1], -PLAN_FARTHEST), PLAN_FARTHEST);
        scratch->away[k] = sqrt(x * x + y * y);
    }
    for (k = 0; k < count; k++) {
        int other;
        for (other = rank = 0; other < count; other++)
            rank += scratch->away[other] < scratch->away[k]
                || (scratch->away[other] == scratch->away[k] && other < k);
        scratch->order[k] = rank;
    }
    for (k = 0; k < count; k++)
        if (scratch->order[k] < PLAN_MOST) seen[kept++] = seen[k];
    return kept;
}

/* ---- Names, see framework/tracking/names.py */

static double apart(const double *one, const double *other)
{
    return sqrt((one[0] - other[0]) * (one[0] - other[0])
        + (one[1] - other[1]) * (one[1] - other[1]));
}

/* Whether an identity was ever that of two detections of one observation. */
static int shared(const struct history *history, const char *name)
{
    int k;
    for (k = 0; k < history->shared; k++)
        if (strcmp(history->names[k], name) == 0) return 1;
    return !name[0];
}

static void find_shared(struct history *history, const wideberth_detection *seen, int count)
{
    int k;
    for (k = 1; k < count; k++) {
        if (!named(seen, k, seen[k].name) || shared(history, seen[k].name)) continue;
        if (history->shared == PLAN_MOST) history->shared = 0;
        memcpy(history->names[history->shared++], seen[k].name, WIDEBERTH_NAME);
    }
}

/* Give unnamed detections the names of the nearest unnamed obstacles, nearest pair first, or new
 * ones. Python assigns them all at once, and expects each obstacle farther on (Identities). */
static void number(struct history *history, wideberth_detection *seen, int count,
    struct scratch *scratch)
{
    int k, o, best, other, *open = scratch->order;
    for (k = 0; k < count; k++) open[k] = shared(history, seen[k].name);
    for (o = 0; o < history->count; o++) history->logs[o].claimed = 0;
    for (;;) {
        double least = INFINITY;
        for (k = 0, best = other = -1; k < count; k++) {
            for (o = 0; open[k] && o < history->count; o++) {
                const struct log *log = &history->logs[o];
                const double lag = history->stamp - log->reported;
                const double reach = PLAN_CHANGE * fmin(lag, PLAN_LONGEST_GAP)
                    + 6.0 * PLAN_UNNAMED_DEVIATION;
                const double gap = apart(seen[k].position, log->place);
                if (!log->unnamed || log->claimed || lag > PLAN_REMEMBERED || !(gap < reach))
                    continue;
                if (gap < least) least = gap, best = k, other = o;
            }
        }
        if (best < 0) break;
        open[best] = 0, history->logs[other].claimed = 1;
        memcpy(seen[best].name, history->logs[other].name, WIDEBERTH_NAME);
    }
    for (;;) { /* the lowest first, so that names do not depend on the order of detections */
        for (k = 0, best = -1; k < count; k++)
            if (open[k] && (best < 0 || seen[k].position[1] < seen[best].position[1]
                || (seen[k].position[1] == seen[best].position[1]
                    && seen[k].position[0] < seen[best].position[0])))
                best = k;
        if (best < 0) return;
        open[best] = 0;
        do
            snprintf(seen[best].name, WIDEBERTH_NAME, "#%d", ++history->born);
        while (named(seen, best, seen[best].name)
            || named(seen + best + 1, count - best - 1, seen[best].name));
    }
}

struct owner {
    const struct log *log;
    double reach, share; /* m that it can have moved, and the share of it that it would have */
};

/* The obstacle that a named detection is of; without a log where it is not known. */
static struct owner owner_of(const struct history *history, const wideberth_detection *one)
{
    struct owner best = {NULL, 0.0, INFINITY};
    const size_t length = strlen(one->name);
    int k;
    for (k = 0; k < history->count; k++) {
        const struct log *log = &history->logs[k];
        const int further = log->stem == length && strncmp(log->name, one->name, length) == 0;
        double lag, reach, share;
        if (!further && strcmp(log->name, one->name) != 0) continue;
        lag = fabs(history->stamp - one->age - log->now.time);
        reach = PLAN_LEAP + PLAN_OBSTACLE_SPEED * lag;
        share = apart(one->position, log->place) / reach;
        if (!best.log || share < best.share) best.log = log, best.reach = reach, best.share = share;
    }
    return best;
}

static double median(double *values, int count)
{
    int k, place;
    for (k = 1; k < count; k++) {
        const double value = values[k];
        for (place = k; place > 0 && values[place - 1] > value; place--)
            values[place] = values[place - 1];
        values[place] = value;
    }
    return 0.5 * (values[(count - 1) / 2] + values[count / 2]);
}

/* Whether all known obstacles have moved by the same vector: the frame was corrected. */
static int frame_moved(const wideberth_detection *seen, const struct owner *owners, int count)
{
    double moved[2], values[PLAN_MOST];
    int k, axis, known = 0;
    for (axis = 0; axis < 2; axis++) {
        for (k = known = 0; k < count; k++) {
            if (!owners[k].log) continue;
            if (!(owners[k].share > 1.0)) return 0;
            values[known++] = seen[k].position[axis] - owners[k].log->place[axis];
        }
        if (known < 2) return 0;
        moved[axis] = median(values, known);
    }
    for (k = 0; k < count; k++) {
        double off[2];
        if (!owners[k].log) continue;
        for (axis = 0; axis < 2; axis++)
            off[axis] = seen[k].position[axis] - owners[k].log->place[axis];
        if (!(apart(off, moved) <= owners[k].reach)) return 0;
    }
    return 1;
}

/* Give each detection the name of its obstacle; `stems` holds the length of the identity where an
 * obstacle of that identity is known that it cannot be. */
static void assign(struct history *history, wideberth_detection *seen, int count, size_t *stems,
    struct scratch *scratch)
{
    struct owner owners[PLAN_MOST];
    int k, whole, number_of;
    find_shared(history, seen, count);
    for (k = 0; k < count; k++) {
        owners[k].log = NULL, owners[k].share = 0.0, stems[k] = 0;
        if (!shared(history, seen[k].name)) owners[k] = owner_of(history, &seen[k]);
    }
    number(history, seen, count, scratch);
    whole = frame_moved(seen, owners, count);
    for (k = 0; k < count; k++) {
        char name[WIDEBERTH_NAME + 16];
        const struct log *log = owners[k].log;
        if (!log) continue;
        if ((whole || !(owners[k].share > 1.0)) && !named(seen, k, log->name)) {
            memcpy(seen[k].name, log->name, WIDEBERTH_NAME);
            continue;
        }
        stems[k] = strlen(seen[k].name);
        for (number_of = 2;; number_of++) {
            snprintf(name, sizeof(name), "%.*s#%d", WIDEBERTH_NAME - 8, seen[k].name, number_of);
            name[WIDEBERTH_NAME - 1] = '\0';
            if (!named(seen, count, name) && !known(history, name)) break;
        }
        memcpy(seen[k].name, name, WIDEBERTH_NAME);
    }
}

/* Filter a measurement; one of the same time as the newest one takes its place. One that is older
 * than that is not used: Python inserts it and filters again. */
static void measured(struct log *log, double time, const double *place, const double *covariance)
{
    const double slack = PLAN_SAME_TIME * PLAN_TRACK_DT, since = time - log->now.time;
    if (since < -slack) return;
    if (since > slack && time - log->before.time >= PLAN_TRACK_DT / PLAN_DENSEST)
        log->before = log->now;
    log->now = log->before;
    wb_filter(&log->now, time, place, covariance);
    memcpy(log->place, place, sizeof(log->place));
}

static void removed(struct history *history, int place)
{
    memmove(&history->logs[place], &history->logs[place + 1],
        (size_t)(history->count - place - 1) * sizeof(history->logs[0]));
    history->count--;
}

static void forget(struct history *history, double stamp)
{
    int k, oldest;
    for (k = history->count - 1; k >= 0; k--)
        if (stamp - history->logs[k].reported > PLAN_FORGET) removed(history, k);
    while (history->count > PLAN_MOST) {
        for (k = 1, oldest = 0; k < history->count; k++)
            if (history->logs[k].reported < history->logs[oldest].reported) oldest = k;
        removed(history, oldest);
    }
}

void wb_take(struct history *history, const wideberth_observation *seen, const double *here,
    struct scratch *scratch)
{
    size_t stems[PLAN_MOST];
    int count, k;
    if (!isfinite(seen->stamp)) return;
    if (seen->stamp < history->stamp) /* a clock that goes back */
        history->count = history->shared = history->born = 0;
    history->stamp = seen->stamp;
    count = nearest(scratch->seen, admitted(history, seen, scratch), here, scratch);
    assign(history, scratch->seen, count, stems, scratch);
    for (k = 0; k < count; k++) {
        const wideberth_detection *one = &scratch->seen[k];
        struct log *log = known(history, one->name);
        if (!log) {
            log = &history->logs[history->count++];
            memset(log, 0, sizeof(*log));
            memcpy(log->name, one->name, sizeof(log->name));
            log->stem = stems[k], log->unnamed = one->name[0] == '#';
            log->now.time = log->before.time = -INFINITY;
        }
        measured(log, seen->stamp - one->age, one->position, one->covariance);
        log->reported = seen->stamp, log->radius = one->radius;
        memcpy(log->covariance, one->covariance, sizeof(log->covariance));
    }
    forget(history, seen->stamp);
}

void wb_tracks(const struct history *history, struct tracks *tracks)
{
    int k, place;
    tracks->count = history->count, tracks->stamp = -INFINITY;
    for (k = 0; k < history->count; k++) {
        const struct log *log = &history->logs[k];
        for (place = k; place > 0 && strcmp(tracks->of[place - 1]->name, log->name) > 0; place--)
            tracks->of[place] = tracks->of[place - 1];
        tracks->of[place] = log;
        tracks->stamp = fmax(tracks->stamp, log->now.time);
    }
}
