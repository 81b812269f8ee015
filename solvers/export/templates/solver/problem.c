/* {{ source }}: stage functions, sizes and bounds. Made by wideberth. */
#include "problem.h"

#include <string.h>

#if WIDEBERTH_BUILD != UINT64_C({{ build }})
#error "wideberth: problem.c and wideberth_solver.h are of different exports"
#endif

{{ functions }}
{% for name, values in arrays %}
static const {{ name }}[] = { {{- values|join(", ") or "0" -}} };
{% endfor %}

static const wb_kind KINDS[WIDEBERTH_KINDS] = {
{% for one in kinds %}
    {
{% for name, value in one.core %}
        .{{ name }} = {{ value }},
{% endfor %}
    },
{% endfor %}
};

const wb_problem wideberth_core = {
{% for name, value in core %}
    .{{ name }} = {{ value }},
{% endfor %}
    .kind = KINDS,
};

const wb_settings wideberth_settings = {
{% for name, value in settings %}
    .{{ name }} = {{ value }},
{% endfor %}
};

const wideberth_kind wideberth_kinds[WIDEBERTH_KINDS] = {
{% for one in kinds %}
    {AIM_{{ loop.index0 }}, BEGIN_{{ loop.index0 }}, {{ one.set }}, {{ one.check }}},
{% endfor %}
};

void wideberth_slots(const wideberth_problem *problem, const wideberth_result *result,
    wb_slots *slots)
{
    memset(slots, 0, WIDEBERTH_KINDS * sizeof *slots);
    (void)problem, (void)result;
{% for one in kinds %}
{% for name, value in one.places %}
    slots[{{ one.place }}].{{ name }} = {{ value }};
{% endfor %}
{% endfor %}
}
