within HystId;
package Components "Parts of models that are no force themselves"
end Components;
