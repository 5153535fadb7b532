// "Did you mean ...?": the known word that somebody probably meant to type.
//
// Distance: the smallest number of letters inserted, left out, replaced or swapped with their neighbour, no stretch edited twice
// (optimal string alignment). Close is up to one error for every three letters of what was typed, three at most.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace turncal {

std::size_t edit_distance(std::string_view a, std::string_view b);

// "; did you mean 'run'?", to put behind a message; nothing when no word is close. Of equally close ones: one with the same first
// letter, then the first.
std::string did_you_mean(std::string_view typed, const std::vector<std::string>& known);

}  // namespace turncal
