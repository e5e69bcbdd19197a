within HystId;
package Oscillators "One mass, one law: input F, outputs x, v, a, R"
end Oscillators;
