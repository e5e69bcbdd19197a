package HystId "Hysteretic oscillators, their restoring-force laws, and the effects that such laws leave out"
end HystId;
