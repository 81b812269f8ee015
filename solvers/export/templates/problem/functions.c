/* Tables, and functions that call the generated ones. */
#include "wideberth.h"

#include <stddef.h>

{% for kind, name, values in arrays %}
{{ c_array(kind, "wideberth_" ~ name, values) }}
{% endfor %}
{% for routine in routines %}
int wideberth_casadi_{{ routine.name }}(const double **, double **, long long int *, double *, int);
{{ routine|signature }}
{
    const double *given[{{ routine.function.sz_arg() }}];
    double *found[{{ routine.function.sz_res() }}];
{% for name in routine.arguments %}
    given[{{ loop.index0 }}] = {{ name }};
{% endfor %}
    found[0] = {{ routine.result }};
    wideberth_casadi_{{ routine.name }}(given, found, NULL, NULL, 0);
}
{% if not loop.last %}

{% endif %}
{% endfor %}
